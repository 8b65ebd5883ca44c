"""Hold the object with a device of one's own, beside a simulated partner: here a slider of 0.2 kg in a soft spring."""

import cogrip.api as cogrip


class Slider:
    """A mass m on a spring k with a damper d, whose rest position goes back and forth; stepped once a tick."""

    def __init__(self) -> None:
        self.x = self.v = self.t = 0.0

    def move(self, time_s: float, force_n: tuple[float, ...]) -> tuple[float, ...]:
        dt, self.t = time_s - self.t, time_s
        rest = 0.02 if time_s % 2.0 > 1.0 else 0.0
        self.v += dt * (300.0 * (rest - self.x) - 8.0 * self.v - force_n[0]) / 0.2
        self.x += dt * self.v
        return (self.x,)


frames: list[cogrip.Frame] = []
with cogrip.Session("demo", mine=["ben"], seconds=2.0, object={"axes": 1}) as session:
    slider = cogrip.device_of(Slider().move, apparent_mass_kg=0.2, damping_nspm=40.0)
    session.client("ben", slider, on_frame=frames.append)
    run = session.wait()
print(
    f"{len(frames)} frames; anna felt up to {abs(run.columns('anna', 'force_n')['force_n']).max():.2f} N; good: {run.good}"
)
