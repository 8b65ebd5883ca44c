"""Settings files that come with cogrip: the folder configs/ of a checkout, which a wheel has inside the package."""

from difflib import get_close_matches
from importlib.resources import files
from pathlib import Path

SUFFIX = ".toml"


def shipped_folder() -> Path:
    """Return the folder with the settings that come with cogrip."""
    packed = Path(str(files("cogrip.cli") / "configs"))
    return packed if packed.is_dir() else Path(__file__).resolve().parents[4] / "configs"


def shipped_names() -> list[str]:
    """Return the names of all of them, in order."""
    return sorted(path.stem for path in shipped_folder().glob(f"*{SUFFIX}"))


def shipped(name: str) -> Path:
    """Return the path of the file called `name`, whether it exists or not."""
    return shipped_folder() / f"{name}{SUFFIX}"


def shipped_scene(name: str) -> Path:
    """Return the path of the scene in the file called `name`, whether it exists or not."""
    return (shipped_folder() / "scenes" / name).resolve()


def summary_of(name: str) -> str:
    """Return the first line of its leading comment, which describes it; its name where there is none."""
    first = shipped(name).read_text(encoding="utf-8").partition("\n")[0]
    return first.lstrip("# ") if first.startswith("#") else name


def is_name(path: Path) -> bool:
    """Return whether `path` is a bare name, such as `demo`: neither a folder nor a suffix in it."""
    return len(path.parts) == 1 and not path.suffix


def no_such_settings(name: str) -> str:
    """Return the error for `name`, with the closest name and all of them."""
    names = shipped_names()
    close = get_close_matches(name, names, n=1)
    cure = f"; did you mean {close[0]}?" if close else "."
    return f"no settings of that name come with cogrip{cure} There are: {', '.join(names)}"
