"""Reading and writing images: HDR and PFM here, PNG and JPEG by imageio, EXR by OpenEXR."""
