"""How light is computed: Warp code, one concept a file. Knows no sockets and no files."""

from wdpm.kernels.late_builtins import make_late

make_late()
