"""`python3 dev.py bench NAME`: benchmarks, as ratios of what was measured side by side in one run."""

import sys
from collections.abc import Sequence

from cyclopts import App, CycloptsError

from cogrip.cli.terminal.flag_errors import words_of
from cogrip.cli.terminal.problem import Problem

BENCHES = {  # each is the function bench_NAME of tests.bench.NAME, with _ for -
    "capacity": "Measure what people cost a core, a join and a cluster's directory; compute what hosts and clusters carry.",
    "client": "Measure what a live client's tick takes at 1024 and 8192 Hz, encrypted and recorded, and how many ticks run.",
    "cluster": "Kill a host of a Ray cluster and drain another: time until all are back, steps of force, the other rooms.",
    "concealment": "Compare every packet loss concealment under the same hands, loss, jitter and outages, with a clean link.",
    "cost": "Measure what a person costs the server: back to back, at its pace, then socket, encryption and recording.",
    "devices": "Run live sessions with emulated arms on serial lines, and the same with simulated devices.",
    "drawing": "Compare the page's pictures of twenty scenes with MuJoCo's own renderer, pixel by pixel.",
    "gates": "Put random sessions of partners' models, some of whose people lie, to the law of their energy gates.",
    "guard": "Look whether a guard within a session could find faults of a device early, and no hand: three statistics.",
    "hosts": "Measure memory, threads and ports of hosts of a Ray cluster and their rooms, beside an ordinary server.",
    "idle": "Measure what rooms without people cost a server, beside those in use.",
    "impaired": "Run whole sessions on every impaired network: each must be passive and hold; the baselines must fail.",
    "killed": "Kill workers of a server with -9: time until all are back, steps of force, the other rooms.",
    "network": "Count the people whom one core serves, encrypted and not, beside a socket echo; or flood an encrypted server.",
    "partner": "Compare what hands feel of each other by models of partners with wave lines and no force, in tasks.",
    "partner-live": "Hold a cube through a relay, live, by waves and by models of each other: how far the forces are off.",
    "pauses": "Measure what this processor forgets between two ticks, and how often something takes it away.",
    "peers": "Compare what a person costs the server with a server in C, VRPN and a bare Python echo.",
    "playout": "Compare the adaptive jitter buffer with the best fixed playout delay in hindsight, on each network.",
    "recording": "Run live sessions with recording and without, in turns; measure the size and reading speed of the files.",
    "relay": "Measure the delay that `cogrip relay` itself adds to a datagram.",
    "scenes": "Measure the time of a frame of each scene that comes with cogrip, under hands that push at random.",
    "soak": "Run people at a server through a relay for a long time; report who was lost, and memory that grew.",
    "stability": "Trace the boundary of the stable region, and compare its time with eigenvalues on a dense grid.",
    "sweep": "Run the same cases with one worker and with several.",
    "thresholds": "Estimate thresholds of simulated observers that the fit does not assume: bias, coverage, spread.",
    "tick": "Measure a client's tick with each coupling, and the same session with plain wave lines beside it.",
    "tokens": "Measure what a token in a hello costs a server: stored, signed, known, wrong.",
    "trial": "Try motors before a seat on emulated arms with each fault, and with none: what is named, what is not.",
    "upgrade": "Start the hosts of a Ray cluster anew one by one under people: seats lost, silences, steps of force.",
    "velocity": "Compare velocity estimators on recorded hands and in sessions, and report the impedance each device carries.",
    "view": "Measure a 1 kHz client beside tabs, a tab that hangs, 50 tabs, and how soon the server feels a pointer.",
    "workers": "Measure how many more people several workers carry than one process, and what people cost under a flood.",
}
RENAMED = {"storms": "impaired", "partners": "partner-live"}
"""Benchmarks of earlier versions by their present names."""

bench = App(name="dev.py bench", help="Measure this machine: ratios of what is timed side by side in one run.")
for _name, _help in BENCHES.items():
    _module = _name.replace("-", "_")
    bench.command(f"tests.bench.{_module}:bench_{_module}", name=_name, help=_help)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one benchmark, of the command line if no arguments are given. Exit codes are those of `cogrip`."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    if words and words[0] in RENAMED:
        print(f"dev.py bench: {words[0]} is called {RENAMED[words[0]]} now", file=sys.stderr)
        words[0] = RENAMED[words[0]]
    try:
        code = bench(words, exit_on_error=False, print_error=False, result_action="return_value")
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
