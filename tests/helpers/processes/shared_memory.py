"""Whether this system lets processes of one user share memory as slaves do: some sandboxes do not."""

from __future__ import annotations

import functools
import subprocess
import sys
import tempfile
from pathlib import Path

from patience import WAIT_S

from wdpm.cluster.transport.host_share import host_share

_READ = """
import sys
from pathlib import Path
from wdpm.cluster.transport.host_share import HostShare
with HostShare(Path(sys.argv[1])).claim("probe") as claim:
    sys.exit(0 if claim.found is not None and bytes(claim.found) == b"there" else 9)
"""


@functools.cache
def memory_is_shared() -> bool:
    """Whether another process finds what this one has made."""
    with tempfile.TemporaryDirectory() as folder:
        share = host_share(Path(folder))
        if share is None:
            return False
        with share.claim("probe") as claim:
            kept = None if claim is None else claim.publish([memoryview(b"there")])
        if kept is None:
            return False
        command = [sys.executable, "-c", _READ, folder]
        return subprocess.run(command, check=False, capture_output=True, timeout=WAIT_S).returncode == 0
