"""A whole session by the client that openapi-python-client has generated, which is on the path.

Run in the generator's own environment: `python python_session.py URL MASK.png FOLDER`; writes what it downloads to the
folder and prints what it has seen as one JSON object.
"""

import json
import re
import sys
import time
from io import BytesIO
from pathlib import Path

from lightpose_client import Client  # pyright: ignore
from lightpose_client.api.events import events  # pyright: ignore
from lightpose_client.api.rig import rig  # pyright: ignore
from lightpose_client.api.sessions import act, artefact, create, draw_region, image, read  # pyright: ignore
from lightpose_client.models import (  # pyright: ignore
    ActionRequest,
    ActionRequestAction,
    EventResource,
    Problem,
    Recipe,
)
from lightpose_client.types import File  # pyright: ignore

ENDED = ("completed", "stopped", "failed", "interrupted")
WITHIN_S = 240.0


def main(url: str, mask: Path, folder: Path) -> dict[str, object]:
    """Runs the session; what was seen."""
    client = Client(url, timeout=120)
    may_start = rig.sync(client=client).may_start
    recipe = Recipe(label="generated", pilot_lights=4, planned_lights=3, seed=1)
    session = create.sync(client=client, body=recipe, idempotency_key="python-1")
    again = create.sync(client=client, body=recipe, idempotency_key="python-1")
    upload = File(payload=BytesIO(mask.read_bytes()), file_name=mask.name, mime_type="image/png")
    region = draw_region.sync(session.id, client=client, body=upload)
    act.sync(session.id, client=client, body=ActionRequest(ActionRequestAction.START))

    heard: list[EventResource] = []
    deadline = time.monotonic() + WITHIN_S
    while not any(event.type_ == "session.state" and event.body["state"] in ENDED for event in heard):
        if time.monotonic() > deadline:
            raise TimeoutError([event.type_ for event in heard])
        last = str(heard[-1].id) if heard else "0"
        text = events.sync(client=client, session_id=session.id, follow=False, last_event_id=last)
        lines = re.findall(r"^data: (.*)$", text, re.MULTILINE)
        heard += [EventResource.from_dict(json.loads(line)) for line in lines]
        time.sleep(0.2)

    done = read.sync(session.id, client=client)
    normals = artefact.sync(session.id, done.answer.number, "normals.png", client=client)
    (folder / "normals.png").write_bytes(normals.payload.read())
    (folder / "image.png").write_bytes(image.sync(session.id, 0, 0, client=client).payload.read())
    missing = read.sync("no-such-session", client=client)
    return {
        "may_start": may_start,
        "same": again.id == session.id,
        "region_pixels": region.pixels,
        "event_ids": [event.id for event in heard],
        "event_types": sorted({event.type_ for event in heard}),
        "state": str(done.state),
        "sigma_deg": done.answer.summary.mean_sigma_deg,
        "missing": str(missing.code) if isinstance(missing, Problem) else "no problem",
    }


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3]))))
