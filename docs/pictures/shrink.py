"""Makes pictures small enough for the documents: python shrink.py PICTURE.png... (needs Pillow)

At most 800 pixels along the longer edge and 128 colours: a render of the command becomes a tenth of its length.
"""

import sys

from PIL import Image

for path in sys.argv[1:]:
    with Image.open(path) as image:
        picture = image.convert("RGB")
    picture.thumbnail((800, 800), Image.Resampling.LANCZOS)
    picture.quantize(128, dither=Image.Dither.NONE).save(path, optimize=True)
