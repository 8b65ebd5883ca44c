"""`python3 dev.py bench NAME`: benchmarks, as ratios of what was measured side by side in one run."""

import sys

from cyclopts import App, CycloptsError

from cogrip.cli.terminal.flag_errors import words_of
from cogrip.cli.terminal.problem import Problem

BENCHES = {
    "concealment": (
        "tests.bench.bench_concealment:bench_concealment",
        "Ways through gaps under the same hands, in a storm of loss, jitter and outages, beside a clean link.",
    ),
    "stability": (
        "tests.bench.bench_stability:bench_stability",
        "Trace the stable region's outline, against eigenvalues on a dense grid.",
    ),
    "recording": (
        "tests.bench.bench_recording:bench_recording",
        "Live sessions with recording and without, in turns; the size of their files, and how fast they are read.",
    ),
    "devices": (
        "tests.bench.bench_devices:bench_devices",
        "Live sessions with emulated arms on serial lines, beside the same with simulated devices.",
    ),
    "network": (
        "tests.bench.bench_network:bench_network",
        "How many people one core serves, plain and sealed, beside a bare socket echo; or a sealed server under a flood.",
    ),
    "soak": (
        "tests.bench.bench_soak:bench_soak",
        "People at a server through a relay for a long time: who was lost, and what has grown.",
    ),
    "storms": (
        "tests.bench.bench_storms:bench_storms",
        "Whole sessions on every network, by people, stiffness and seed: each must be passive and hold; baselines must fail.",
    ),
    "playout": (
        "tests.bench.bench_playout:bench_playout",
        "The playout that follows the jitter, beside the best fixed depth chosen with hindsight, on each network.",
    ),
    "relay": (
        "tests.bench.bench_relay:bench_relay",
        "What `cogrip relay` adds to a datagram by itself, beside direct ones.",
    ),
    "sweep": ("tests.bench.bench_sweep:bench_sweep", "Run the same cells with one worker and with several."),
    "velocity": (
        "tests.bench.bench_velocity:bench_velocity",
        "Velocity estimators on recorded hands and in sessions, for each device; what impedance each device carries.",
    ),
}


bench = App(name="dev.py bench", help="Measure this machine: ratios of what is timed side by side in one run.")
for _name, (_target, _help) in BENCHES.items():
    bench.command(_target, name=_name, help=_help)


def main() -> int:
    """Run one benchmark. Exit codes as those of `cogrip`."""
    try:
        code = bench(exit_on_error=False, print_error=False, result_action="return_value")
    except CycloptsError as error:
        print(f"dev.py bench: {words_of(error, tuple(BENCHES))}", file=sys.stderr)
        return 2
    except Problem as problem:
        print(f"dev.py bench: {problem}", file=sys.stderr)
        return problem.exit_code
    except KeyboardInterrupt:
        print("dev.py bench: interrupted", file=sys.stderr)
        return 130
    return code if isinstance(code, int) else 0


if __name__ == "__main__":
    sys.exit(main())
