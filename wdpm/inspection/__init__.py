"""What is in a scene, and what each slave would hold of it (`wdpm inspect`)."""
