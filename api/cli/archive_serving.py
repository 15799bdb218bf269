"""The work of `lightpose archive serve`, imported inside the command so that it can report a missing extra."""

from typing import Any

from acquisition.models.errors import ErrorCode, RigError


def serve(address: str, wanted: dict[str, Any]) -> None:
    """Serves an archive's page until a signal ends it. Raises RigError config.invalid without the extra `archive`."""
    try:
        from api.rest.archive_page import server  # noqa: PLC0415 - needs the extra `archive`
    except ModuleNotFoundError as error:
        raise RigError(
            ErrorCode.CONFIG_INVALID, f"{error.name} is not installed: pip install 'lightpose[archive]'"
        ) from error
    from api.rest.server import announce  # noqa: PLC0415
    from api.rest.settings import read_as  # noqa: PLC0415

    server.serve(read_as(server.ArchivePageSettings, archive=address, **wanted), announce)
