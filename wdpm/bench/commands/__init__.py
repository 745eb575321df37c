"""What `wdpm bench` offers: a file for each benchmark, with its name, its options and what runs it."""
