"""wdpm on GPUs: kernels compile for them anywhere; where there is one, its bits are compared with the CPU's."""
