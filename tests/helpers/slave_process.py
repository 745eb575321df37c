"""A slave process with a worker that knows no light.

slave_process.py ENDPOINT SECONDS_PER_TASK [life-line] [rejoin=SECONDS]
"""

import functools
import sys
from pathlib import Path

from fake_worker import FakeWorker

sys.path.append(str(Path(__file__).with_name("processes")))  # pytest has it from pyproject.toml
from patience import WAIT_S

from wdpm.cluster.slave.process import run_slave

endpoint, delay = sys.argv[1], float(sys.argv[2])
run_slave(
    endpoint,
    functools.partial(FakeWorker, delay=delay),
    life_line=sys.stdin.fileno() if "life-line" in sys.argv else None,
    patience=WAIT_S,
    rejoin=next((float(each[7:]) for each in sys.argv if each.startswith("rejoin=")), WAIT_S),
    agreed={"code": "1"},
)
