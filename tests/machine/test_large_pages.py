"""Large pages: small and large objects lie where the kernel was asked for them, freed memory goes back, refusals say why."""

import subprocess
import sys
from pathlib import Path

import pytest

from cogrip.machine import large_pages

interpreted = str(large_pages.__file__).endswith(".py")
needs_compiled = pytest.mark.skipif(interpreted, reason="large_pages is not compiled (`python3 dev.py compile`)")
needs_kernel = pytest.mark.skipif(large_pages.large_pages_permission() != "yes", reason="no large pages here")

OF_ADDRESSES = """
import re, sys
from cogrip.machine.large_pages import use_large_pages

def asked():
    "Return the spans of addresses for which large pages are asked for."
    parts = re.split(r"^(?=[0-9a-f]+-[0-9a-f]+ )", open("/proc/self/smaps").read(), flags=re.MULTILINE)[1:]
    return [[int(end, 16) for end in part.split()[0].split("-")] for part in parts
            if "hg" in part.partition("VmFlags:")[2].split()]

def share(objects):
    "Return how much of these objects lies there."
    spans = asked()
    return sum(any(start <= id(each) < end for start, end in spans) for each in objects) / len(objects)

def pages():
    return sum(end - start for start, end in asked()) >> 21
"""


def said(program: str) -> str:
    answer = subprocess.run(
        [sys.executable, "-P", "-c", OF_ADDRESSES + program], capture_output=True, text=True, timeout=60.0, check=True
    )
    return answer.stdout.strip()


@needs_compiled
@needs_kernel
@pytest.mark.parametrize("size", [16, 100, 400, 600, 4000, 50_000])
def test_objects_of_each_size_lie_in_large_pages_once_they_are_asked_for(size: int) -> None:
    """One of the 84 largest may lie in what was free before."""
    program = f"""
before = [bytes({size} + n % 2) for n in range(100)]
use_large_pages()
use_large_pages()
count = (6 << 20) // {size}
made = [bytes({size} + n % 2) for n in range(count)]
print(share(before) < 0.1, share(made[count // 3:]) > 0.98)
"""
    assert said(program) == "True True"


@needs_compiled
@needs_kernel
def test_memory_of_freed_objects_goes_back_and_is_taken_again() -> None:
    program = """
kept = [b"%d" % n for n in range(200_000)]
use_large_pages()
empty = pages()
made = [b"%d" % n for n in range(1_000_000)]
full = pages()
del kept  # these lie in arenas from before
del made
freed = pages()
made = [b"%d" % n for n in range(1_000_000)]
print(full - empty > 15, freed - empty < 3, abs(pages() - full) < 3, made[-1])
"""
    assert said(program) == "True True True b'999999'"


@needs_compiled
@needs_kernel
def test_a_process_whose_memory_is_locked_gets_them_too() -> None:
    program = """
import ctypes
FUTURE = 2
locked = ctypes.CDLL(None).mlockall(FUTURE) == 0
use_large_pages()
made = [b"%d" % n for n in range(1_000_000)]
text = open("/proc/self/smaps").read()
print(locked, sum(map(int, re.findall(r"AnonHugePages: +(\\d+)", text))) >> 10)
"""
    locked, megabytes = said(program).split()
    if locked != "True":
        pytest.skip("memory must not be locked here")
    free = said(program.replace("FUTURE) == 0", "0) == 0")).split()[1]
    if int(free) < 30:
        pytest.skip("the kernel has no large pages to give")
    assert int(megabytes) >= 30


@needs_compiled
def test_a_refusal_says_why(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    setting = tmp_path / "enabled"
    monkeypatch.setattr(large_pages, "SETTING", str(setting))
    assert large_pages.large_pages_permission() == "no, this kernel has none"
    setting.write_text("always madvise [never]\n")
    assert large_pages.large_pages_permission() == f"no, {setting} says never (madvise will do)"
    for granted in ("always [madvise] never\n", "[always] madvise never\n"):
        setting.write_text(granted)
        assert large_pages.large_pages_permission() == "yes"


@pytest.mark.skipif(not interpreted, reason="large_pages is compiled")
def test_without_the_compiled_form_nothing_changes() -> None:
    large_pages.use_large_pages()
    assert large_pages.large_pages_permission() == "no, only in the compiled form on Linux (`python3 dev.py compile`)"
