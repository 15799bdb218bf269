"""The container image: every step of the Containerfile is executed, and what it gives serves a simulated cell.

No registry of images is asked: the base image is stood in for by a fresh Debian of the same Python (debootstrap).
buildah executes the steps in no more than a chroot (`--isolation chroot`). Takes some ten minutes, most of it pip and
the compilation of the kernels.
"""

import json
import os
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import pytest

TOP = Path(__file__).parents[2]
BASE = "localhost/base"
PACKAGES = "python3,python3-pip,python3-venv,python3-dev,ca-certificates"

SERVED = """
set -e
lightpose keys add me --role admin --data /data
lightpose sim --cell hardware_sim/cells/cell.sim.toml --object sphere --speed 20 --pixels 96 --folder /tmp/cell &
sim=$!
until [ -f /tmp/cell/cell.toml ]; do sleep 1; kill -0 $sim; done
lightpose serve --cell /tmp/cell/cell.toml --data /data --port 8765 &
service=$!
python3 - <<'END'
import time, urllib.request
for _ in range(600):
    try:
        print(urllib.request.urlopen("http://127.0.0.1:8765/health/ready", timeout=5).read().decode())
        break
    except OSError:
        time.sleep(1)
else:
    raise SystemExit("not ready")
END
kill $service $sim
wait $service || [ $? = 143 ]  # ended by SIGTERM, in good order
id -un
"""

pytestmark = [
    pytest.mark.long,
    pytest.mark.skipif(
        shutil.which("buildah") is None or shutil.which("debootstrap") is None or os.geteuid() != 0,
        reason="needs buildah, debootstrap and root",
    ),
]


def run(arguments: Sequence[str], timeout_s: float = 3000) -> str:
    """Output of a command; what it says on standard error is shown where it fails."""
    done = subprocess.run(arguments, capture_output=True, text=True, check=False, timeout=timeout_s)
    assert done.returncode == 0, f"{arguments}: {done.stdout[-3000:]}\n{done.stderr[-3000:]}"
    return done.stdout


def pip_files() -> list[str]:
    """What this machine's pip reads beside the registry: configuration, certificates, folders of wheels."""
    configured = ["/etc/pip.conf", "/etc/ssl/certs", *(os.environ.get(n, "") for n in ("PIP_CONFIG_FILE", "PIP_CERT"))]
    for line in subprocess.run(["pip", "config", "list"], capture_output=True, text=True, check=False).stdout.split():
        configured.append(line.strip("'").partition("=")[2].strip("'") or line.strip("'"))
    paths = [entry.removeprefix("file://") for entry in configured if entry.removeprefix("file://").startswith("/")]
    return sorted({path for path in paths if Path(path).exists()})


def test_image_is_built_of_every_step_and_serves_a_cell(tmp_path: Path) -> None:
    root, context = tmp_path / "base", tmp_path / "context"
    run(["debootstrap", "--variant=minbase", f"--include={PACKAGES}", "bookworm", str(root)])
    (root / "usr/lib/python3.11/EXTERNALLY-MANAGED").unlink()  # the stood-in image's Python is its own
    buildah = ["buildah", f"--root={tmp_path}/store", f"--runroot={tmp_path}/run", "--storage-driver=vfs"]
    base = run([*buildah, "from", "scratch"]).strip()
    run([*buildah, "add", base, str(root), "/"])
    run([*buildah, "commit", "--rm", base, BASE])
    shutil.rmtree(root)
    context.mkdir()
    archive = subprocess.run(["git", "archive", "HEAD"], cwd=TOP, capture_output=True, check=True).stdout
    subprocess.run(["tar", "-x", "-C", str(context)], input=archive, check=True)
    mounts = [f"--volume={path}:{path}:ro" for path in pip_files()]
    environment = [f"--env={name}" for name in os.environ if name.startswith("PIP_")]

    built = [*buildah, "build", "--isolation=chroot", "--pull-never", "--network=host", *mounts, *environment]
    run([*built, f"--from={BASE}", "--file", str(context / "deploy/Containerfile"), "--tag", "lightpose", str(context)])

    told = json.loads(run([*buildah, "inspect", "--type=image", "lightpose"]))["OCIv1"]["config"]
    assert told["User"] == "lightpose"
    assert told["Entrypoint"] == ["lightpose"]
    assert "/data" in told["Volumes"]
    container = run([*buildah, "from", "--pull-never", "lightpose"]).strip()
    said = run([*buildah, "run", "--isolation=chroot", "--network=host", container, "--", "sh", "-c", SERVED])
    assert '"ok"' in said
    assert said.split()[-1] == "lightpose"
