"""`python -m hardware_sim.controller`: a controller as a process of its own.

It prints `ready <address>` when clients can connect, and ends with exit status 0 at SIGTERM or SIGINT.
"""

import argparse
import gc
import logging
import signal
import sys
from dataclasses import fields
from pathlib import Path

from hardware_sim.controller.calibration import TYPICAL_ERROR_M
from hardware_sim.controller.kinematics import JOINT_LIMIT, MODELS
from hardware_sim.controller.options import HOME, ControllerOptions, RealTime
from hardware_sim.controller.server import serve


def _joints(text: str) -> list[float]:
    joints = [float(word) for word in text.split(",")]
    if len(joints) != 6 or not all(abs(q) <= JOINT_LIMIT for q in joints):
        raise argparse.ArgumentTypeError(f"must be six angles within ±2π, not {text}")
    return joints


def main(real_time: RealTime | None = None) -> int:
    """Reads the command line and serves until the end of standard input, SIGTERM or SIGINT."""
    parser = argparse.ArgumentParser(prog=f"python -m {__package__}", description=__doc__)
    parser.add_argument("--address", default="127.0.0.1", help="loopback address; ports as of a real controller")
    parser.add_argument("--model", choices=sorted(MODELS), default="ur5e", help="model of the arm")
    parser.add_argument("--polyscope", choices=["5", "x"], default="5", help="PolyScope version; x has no dashboard")
    parser.add_argument(
        "--robot-api-port", type=int, default=80,
        help="port of the Robot API with --polyscope x; below 1024 may need a privilege",
    )  # fmt: skip
    parser.add_argument("--home", type=_joints, default=HOME, help="initial joints in rad")
    parser.add_argument(
        "--calibration-seed", type=int, help="seed of deviations from the nominal kinematics; default: no deviations"
    )
    parser.add_argument(
        "--calibration-error-m", type=float, default=TYPICAL_ERROR_M,
        help="rms error of the flange's position with --calibration-seed, m",
    )  # fmt: skip
    parser.add_argument("--speed", type=float, default=1.0, help="speed factor of motion")
    parser.add_argument(
        "--low-when-stopped", type=int, nargs="*", default=[], help="digital outputs held low while no program plays"
    )
    parser.add_argument("--surroundings", type=Path, help="file of bodies that the arm can touch (.npz); default: none")
    parser.add_argument("--programs", type=Path, help="folder of programs (NAME.urp, URScript) for `load NAME.urp`")
    parser.add_argument("--record", type=Path, help="append every tick to this file")
    parser.add_argument(
        "--for-urx", action="store_true", help="send mode data as before software 3.5 at port 30002, for urx 0.11.0"
    )
    parser.add_argument("--until-eof", action="store_true", help="end when standard input ends")
    parser.add_argument("--log", default="WARNING", choices=["DEBUG", "INFO", "WARNING", "ERROR"])
    arguments = parser.parse_args()
    if not 0.0 < arguments.speed <= 1000.0:
        parser.error("--speed must be above 0 and at most 1000")
    if not 0.0 < arguments.calibration_error_m <= 0.02:
        parser.error("--calibration-error-m must be above 0 and at most 0.02")
    logging.basicConfig(level=arguments.log, stream=sys.stderr, format="%(asctime)s %(name)s %(message)s")
    ended: list[int] = []
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda number, frame: ended.append(number))
    gc.collect()
    gc.freeze()
    try:
        serve(
            arguments.address,
            ControllerOptions(**{field.name: getattr(arguments, field.name) for field in fields(ControllerOptions)}),
            stop=lambda: bool(ended),
            stop_descriptor=sys.stdin.fileno() if arguments.until_eof else None,
            real_time=real_time,
        )
    except (OSError, ValueError) as error:
        sys.stderr.write(f"{arguments.address}: {error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
