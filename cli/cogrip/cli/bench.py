"""`cogrip bench`: what must be timed, as ratios of what was measured side by side in one run."""

from cyclopts import App

BENCHES = {
    "concealment": (
        "cogrip.cli.bench_concealment:bench_concealment",
        "Ways through gaps under the same hands, in a storm of loss, jitter and outages, beside a clean link.",
    ),
    "stability": (
        "cogrip.cli.bench_stability:bench_stability",
        "Trace the stable region's outline, against eigenvalues on a dense grid.",
    ),
    "recording": (
        "cogrip.cli.bench_recording:bench_recording",
        "Live sessions with recording and without, in turns; the size of their files, and how fast they are read.",
    ),
    "devices": (
        "cogrip.cli.bench_devices:bench_devices",
        "Live sessions with emulated arms on serial lines, beside the same with simulated devices.",
    ),
    "network": (
        "cogrip.cli.bench_network:bench_network",
        "How many people one core serves, plain and sealed, beside a bare socket echo; or a sealed server under a flood.",
    ),
    "soak": (
        "cogrip.cli.bench_soak:bench_soak",
        "People at a server through a relay for a long time: who was lost, and what has grown.",
    ),
    "storms": (
        "cogrip.cli.bench_storms:bench_storms",
        "Whole sessions on every network, by people, stiffness and seed: each must be passive and hold; baselines must fail.",
    ),
    "playout": (
        "cogrip.cli.bench_playout:bench_playout",
        "The playout that follows the jitter, beside the best fixed depth chosen with hindsight, on each network.",
    ),
    "relay": (
        "cogrip.cli.bench_relay:bench_relay",
        "What `cogrip relay` adds to a datagram by itself, beside direct ones.",
    ),
    "sweep": ("cogrip.cli.bench_sweep:bench_sweep", "Run the same cells with one worker and with several."),
    "velocity": (
        "cogrip.cli.bench_velocity:bench_velocity",
        "Velocity estimators on recorded hands and in sessions, for each device; what impedance each device carries.",
    ),
}

bench = App(name="bench", help="Measure this machine: ratios of what is timed side by side in one run.")
for _name, (_target, _help) in BENCHES.items():
    bench.command(_target, name=_name, help=_help)
