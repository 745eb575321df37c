"""A slave process with a worker that knows no light.

slave_process.py ENDPOINT SECONDS_PER_TASK [life-line] [patience=SECONDS]
"""

import functools
import sys

from fake_worker import FakeWorker

from wdpm.cluster.slave.process import run_slave

endpoint, delay = sys.argv[1], float(sys.argv[2])
run_slave(
    endpoint,
    functools.partial(FakeWorker, delay=delay),
    life_line=sys.stdin.fileno() if "life-line" in sys.argv else None,
    patience=next((float(each[9:]) for each in sys.argv if each.startswith("patience=")), 20.0),
    agreed={"code": "1"},
)
