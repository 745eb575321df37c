"""A scene as flat tables: what kernels read and every slave derives."""
