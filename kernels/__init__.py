"""How light is computed: Warp code, one concept a file. Knows no sockets and no files."""
