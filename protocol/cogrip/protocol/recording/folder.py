"""Recordings of a run: the files of a folder, and the users in the order of their seats."""

import json
from difflib import get_close_matches
from pathlib import Path

from cogrip.protocol.recording.reader import Recording, RecordingError, open_recording

RECOVERED = ".recovered.mcap"


def recordings_of(path: Path) -> list[Path]:
    """Return the recordings in a run folder, or the one file that is named; the recovered file where there is one.

    A server of several rooms has one recording for all of them, a folder above. Raises FileNotFoundError.
    """
    if path.is_file():
        return [path]
    if not path.is_dir():
        raise FileNotFoundError(f"{path}: there is no such run; name a run folder or a .mcap file")
    found = sorted(path.glob("*.mcap"))
    if not any(each.name.startswith("server") for each in found):
        found += sorted(path.absolute().parent.glob("server*.mcap"))
    return [each for each in found if each.with_name(f"{each.stem}{RECOVERED}") not in found]


def seats_of(recordings: list[Recording]) -> list[str]:
    """Return the names of all users: by seat where there is a server's recording, then the others."""
    names: dict[str, None] = {}
    for recording in recordings:
        if recording.header.role == "server":
            for room in json.loads(recording.header.start)["rooms"]:
                names.update(dict.fromkeys(user["name"] for user in room["users"]))
    names.update(dict.fromkeys(each.header.who for each in recordings if each.header.role == "client"))
    return list(names)


def find_client(path: Path, user: str) -> Recording:
    """Return the recording of a person, by name or seat number. Raises RecordingError with the names there are."""
    try:
        recordings = [open_recording(file) for file in recordings_of(path)]
    except OSError as error:
        raise RecordingError(str(error) if error.errno is None else f"{path}: {error.strerror}") from None
    people = {each.header.who: each for each in recordings if each.header.role == "client"}
    seats = seats_of(recordings)
    name = seats[int(user)] if user not in people and user.isdecimal() and int(user) < len(seats) else user
    if name not in people:
        there = ", ".join(f"{seats.index(each)} ({each})" for each in people) or "nobody"
        near = get_close_matches(user, people, n=1) or list(people)[:1]
        cure = f"write #user={near[0]}" if near else "name the run folder of a person"
        raise RecordingError(f"{path} holds no recording of user {user}; there is: {there}; {cure}")
    return people[name]
