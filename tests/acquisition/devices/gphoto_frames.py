"""Frames of the virtual DSLR with faults, in a process of its own: the virtual camera takes some forty images.

`python -m tests.acquisition.devices.gphoto_frames FIRST COUNT` prints a JSON line: counts of the account, faults made.
"""

import json
import os
import sys
import tempfile
from collections import Counter
from pathlib import Path

import numpy as np

from acquisition.devices.camera_gphoto import GphotoCamera
from acquisition.devices.frame_accounting import AccountedCamera
from tests.acquisition.devices.camera_return import expose_when_back
from tests.acquisition.devices.virtual_dslr import CONFIG, FIFTIETH, Virtual

FAULT_EVERY = 10


def main(first: int, count: int) -> None:
    """Each frame shows its number, whatever happens before it."""
    with tempfile.TemporaryDirectory() as folder:
        os.environ["VCAMERADIR"] = folder
        virtual = Virtual(Path(folder))
        camera = AccountedCamera(GphotoCamera(CONFIG), CONFIG)
        camera.connect()
        made: Counter[str] = Counter()
        draw = np.random.default_rng(first)
        for number in range(first, first + count):
            label = 100 + number % 3000
            virtual.show(label)
            if number % FAULT_EVERY == FAULT_EVERY // 2:
                fault = str(draw.choice(["reset", "stranger", "doubled"]))
                made[fault] += 1
                match fault:
                    case "reset":  # the cable is pulled: the session with the camera is over
                        camera.driver.close()
                    case "stranger":  # somebody presses the release
                        camera.driver._camera.trigger_capture()  # type: ignore[attr-defined]
                    case _:
                        virtual.put(virtual.last)
            # The fault is over when it has been told: the next image is a good one.
            camera._listeners[:] = [lambda _, label=label: virtual.show(label)]
            frame = expose_when_back(camera, FIFTIETH)
            assert (frame.pixels[0] == label).all(), number
            virtual.last = virtual.content
        camera.close()
        print(json.dumps({"counts": dict(camera.counts), "made": dict(made)}))


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
