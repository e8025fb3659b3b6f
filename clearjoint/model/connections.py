"""What hangs together in a scene, and what was forgotten to be connected."""

from collections.abc import Iterable, Mapping

from .drives.rotation import AbstractDrive
from .joints.base import AbstractElement


def unconnected_bodies(
    bodies: Iterable[str],
    joints: Mapping[str, AbstractElement],
    forces: Mapping[str, AbstractElement],
) -> list[str]:
    """The bodies that no element names, of a scene that has joints."""
    named = {
        body for element in (*joints.values(), *forces.values()) for body in element.body_names()
    }
    return [body for body in bodies if joints and body not in named]


def unheld_drives(
    joints: Mapping[str, AbstractElement], forces: Mapping[str, AbstractElement]
) -> list[str]:
    """The drives about an axis between two bodies that no chain of joints connects."""
    drives = {
        name: element
        for name, element in {**joints, **forces}.items()
        if isinstance(element, AbstractDrive)
    }
    links = [joint.body_names() for name, joint in joints.items() if name not in drives]
    return [
        name
        for name, drive in drives.items()
        if drive.second not in _connected_with(drive.first, links)
    ]


def _connected_with(body: str, links: Iterable[tuple[str, ...]]) -> set[str]:
    """The bodies that links lead to, the body itself among them."""
    found, waiting = {body}, [set(link) for link in links]
    while reached := [link for link in waiting if link & found]:
        found |= set().union(*reached)
        waiting = [link for link in waiting if not link <= found]
    return found
