"""How light is computed: Warp code, one concept a file. Knows no sockets and no files."""

from wdpm.kernels.lazy_builtins import make_lazily

make_lazily()
