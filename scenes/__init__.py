"""What is rendered: the scene's data, its loaders, its checks and the built-in scenes. Knows no Warp."""
