"""Aravis' simulated GigE camera with the features of a real one, on which a previous program has left its settings."""

import ctypes
import fcntl
import re
import tempfile
from collections.abc import Generator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

FIRST_REGISTER = 0x8000
"""Of the simulated camera's memory, which is unused from here on."""

SWITCHES = ("ReverseX", "ReverseY", "GammaEnable", "LUTEnable", "AcquisitionFrameRateEnable")
NUMBERS = ("DecimationHorizontal", "DigitalShift", "TriggerDelay", "BlackLevel")
CHOICES = {"ExposureMode": ("Timed", "TriggerWidth")}


@contextmanager
def used_camera(folder: Path, left: dict[str, str], frame_triggers: str = "Off") -> Generator[Any]:
    """A camera with the features `left` as they are; `frame_triggers` is the trigger mode of AcquisitionStart."""
    import gi

    gi.require_version("Aravis", "0.8")
    from gi.repository import Aravis  # type: ignore[attr-defined]

    with (Path(tempfile.gettempdir()) / "lightpose-gige.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        plain = Aravis.GvFakeCamera.new("127.0.0.1", "plain")
        device = Aravis.Camera.new("127.0.0.1").get_device()
        # The bindings read beyond the text's end; PyGObject's hash of an object is the address of its C structure.
        description_of, size = ctypes.CDLL("libaravis-0.8.so.0").arv_device_get_genicam_xml, ctypes.c_size_t()
        description_of.restype, description_of.argtypes = ctypes.c_void_p, [ctypes.c_void_p, ctypes.c_void_p]
        address = description_of(hash(device), ctypes.byref(size))
        description = ctypes.string_at(address, size.value).decode()
        del device, plain
        (folder / "camera.xml").write_text(_extended(description))
        camera = Aravis.GvFakeCamera.new_full("127.0.0.1", "used", str(folder / "camera.xml"))
        assert camera.is_running()
        previous = Aravis.Camera.new("127.0.0.1").get_device()
        for name in NUMBERS:
            previous.get_feature(name).set_value_from_string("1" if name.startswith("Decimation") else "0")
        for name, value in left.items():
            previous.get_feature(name).set_value_from_string(value)
        previous.set_string_feature_value("TriggerSelector", "AcquisitionStart")
        previous.set_string_feature_value("TriggerMode", frame_triggers)
        previous.leave_control()
        yield camera


def _extended(description: str) -> str:
    """The camera's description with further features, each with a register of its own."""
    parts = []
    address = FIRST_REGISTER
    for name in (*SWITCHES, *NUMBERS, *CHOICES):
        register = f"{name}Register"
        body = f"<pValue>{register}</pValue>"
        if name in SWITCHES:
            parts.append(f'<Boolean Name="{name}">{body}<OnValue>1</OnValue><OffValue>0</OffValue></Boolean>')
        elif name in NUMBERS:
            parts.append(f'<Integer Name="{name}">{body}<Min>0</Min><Max>4095</Max></Integer>')
        else:
            entries = "".join(
                f'<EnumEntry Name="{choice}"><Value>{number}</Value></EnumEntry>'
                for number, choice in enumerate(CHOICES[name])
            )
            parts.append(f'<Enumeration Name="{name}">{entries}{body}</Enumeration>')
        parts.append(
            f'<IntReg Name="{register}"><Address>{address:#x}</Address><Length>4</Length><AccessMode>RW</AccessMode>'
            "<pPort>Device</pPort><Sign>Unsigned</Sign><Endianess>BigEndian</Endianess></IntReg>"
        )
        address += 4
    return re.sub(r"(<Port )", "".join(parts) + r"\1", description, count=1)
