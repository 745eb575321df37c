"""What is written beside one image of one scene: sequences, and images in other formats."""
