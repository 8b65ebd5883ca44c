"""The study that a command names: a file, or one that comes with cogrip, checked before anybody comes."""

import tomllib
from pathlib import Path
from typing import Any

import msgspec

from cogrip.cli.settings.before_run import check_settings
from cogrip.cli.settings.settings_file import load, place_files, refuse_real, try_session
from cogrip.cli.settings.shipped_settings import SUFFIX, is_name, shipped_folder
from cogrip.cli.terminal.problem import BadInput
from cogrip.experiments.study.study_file import Study, StudyError, check, read_study
from cogrip.protocol.settings.sections import Settings

STUDIES = "studies"


def shipped_studies() -> list[str]:
    """Return the names of the studies that come with cogrip."""
    return sorted(path.stem for path in (shipped_folder() / STUDIES).glob(f"*{SUFFIX}"))


def load_study(path: Path, *, live: bool, allow_unstable: bool) -> tuple[Study, dict[str, Any]]:
    """Return a study and the table of its settings file, {} where it names none. Raises BadInput, which names the file."""
    file = shipped_folder() / STUDIES / f"{path.name}{SUFFIX}" if is_name(path) and not path.is_file() else path
    try:
        table = tomllib.loads(file.read_text(encoding="utf-8"))
    except FileNotFoundError:
        there = ", ".join(shipped_studies())
        raise BadInput(f"{path}: there is no such file; give a study's file, or one of: {there}") from None
    except (OSError, UnicodeDecodeError) as error:
        raise BadInput(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    except tomllib.TOMLDecodeError as error:
        raise BadInput(f"{path}: not valid TOML: {error}") from None
    with BadInput.of(StudyError, where=f"{path}: "):
        study = read_study(table)
        for part in (study.session, *study.conditions.values()):
            place_files(part, file.parent)
        base: dict[str, Any] = {}
        if study.settings:
            named = Path(study.settings)
            base = msgspec.to_builtins(load(named if is_name(named) else file.parent / named, world=False))
        sessions = check(study, base)
    for where, settings in _different(sessions):
        if not live:
            refuse_real(settings)
        try_session(settings, f"{path}: {where}")
        check_settings(settings, allow_unstable, where=where)
    return study, base


def _different(sessions: list[tuple[str, Settings]]) -> list[tuple[str, Settings]]:
    """Return the sessions that differ in more than the names of people, with the words for all conditions that have them."""
    found: dict[bytes, tuple[list[str], Settings]] = {}
    for where, settings in sessions:
        users = tuple(msgspec.structs.replace(user, name=str(seat)) for seat, user in enumerate(settings.users))
        key = msgspec.json.encode(msgspec.structs.replace(settings, users=users))
        wheres, _ = found.setdefault(key, ([], settings))
        if where and where.removesuffix(": ") not in wheres:
            wheres.append(where.removesuffix(": "))
    return [(", ".join(wheres) + ": " if wheres else "", settings) for wheres, settings in found.values()]
