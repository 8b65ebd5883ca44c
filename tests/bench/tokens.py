"""`dev.py bench tokens`: what a hello's token costs a server, stored or signed."""

import time
from collections.abc import Callable

from cogrip.cli.terminal.output import make_console
from cogrip.cli.terminal.problem import within
from cogrip.server.admission.signed_tokens import SignedTokenError, SignedTokens, check_signature
from cogrip.server.admission.tokens import TokenBook
from cogrip.server.io.token_file import draw_token
from cogrip.server.rate_limit import SIGNATURES

from tests.server.signers import FINGERPRINT, NOW_S, SecretSigner, Signer

BOOK_TOKENS = 300


def bench_tokens(*, rounds: int = 5, times: int = 300) -> int:
    """Print processor time of each, the least of some rounds, beside a bare Ed25519 verification by the library below.

    Parameters
    ----------
    rounds
        How many, in turns.
    times
        Of each in a round.
    """
    within("--rounds", rounds, 1, 1000)
    within("--times", times, 1, 1_000_000)
    signer, secret, stranger = Signer(), SecretSigner(), Signer(seed=2)
    book, stored = TokenBook().add_key(signer.key()).add_key(secret.key()), draw_token()
    for token in [stored, *(draw_token() for _ in range(BOOK_TOKENS))]:
        book, _ = book.new(token, NOW_S)
    judge, known = SignedTokens(FINGERPRINT, lambda: 0), signer.token()
    good, shared, wrong = signer.token(), secret.token(), stranger.token()
    public, data = signer.private.public_key(), good.rpartition(".")[0].encode()
    signature = signer.signature(data)

    def refused() -> None:
        try:
            check_signature(wrong, book)
        except SignedTokenError:
            return
        raise AssertionError("a wrong signature was taken")

    work: dict[str, Callable[[], object]] = {
        "Ed25519 alone": lambda: public.verify(signature, data),
        "signed, Ed25519": lambda: check_signature(good, book),
        "signed by another key": refused,
        "signed, HS256": lambda: check_signature(shared, book),
        "signed, known": lambda: judge.admit(known, "player", "", book, NOW_S),
        "stored": lambda: book.admit(stored, "player", "", NOW_S),
    }
    least_us = dict.fromkeys(work, float("inf"))
    for _ in range(rounds):
        for name, act in work.items():
            act()
            began_ns = time.thread_time_ns()
            for _ in range(times):
                act()
            least_us[name] = min(least_us[name], (time.thread_time_ns() - began_ns) * 1e-3 / times)
    console = make_console()
    for name, each_us in least_us.items():
        console.print(f"{name:24} {each_us:7.1f} µs", highlight=False)
    most_us = least_us["signed by another key"]
    console.print(
        f"at most {SIGNATURES.per_second} signatures a second: {most_us * SIGNATURES.per_second * 1e-4:.0f} % of this "
        f"processor; {SIGNATURES.burst} at once: {most_us * SIGNATURES.burst * 1e-3:.1f} ms",
        highlight=False, soft_wrap=True,
    )  # fmt: skip
    return 0
