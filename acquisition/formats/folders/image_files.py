"""Reading of image files by rows, from the location of their pixels on disk, so that a stack need not fit into memory.

Uncompressed TIFF is read in place. Every other format is decoded once and in full, a few files at a time, into raw
files of a scratch folder. Both are then a file, an offset and a shape. The operating system's page cache keeps in
memory what fits.
"""

import errno
import struct
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import cv2
import numpy as np
import tifffile
from PIL.Image import Exif
from PIL.JpegImagePlugin import JpegImageFile
from PIL.PngImagePlugin import PngImageFile

from acquisition.formats.folders.refusal import content, refusal
from acquisition.formats.folders.text_table import listed_file
from acquisition.models.base import BoolArray
from acquisition.models.errors import ErrorCode, RigError
from acquisition.normals.images.image_set import StoredValues

FULL_SCALE = {"uint8": 255.0, "uint16": 65535.0, "float32": 1.0}
DECODER_THREADS = 2
"""Number of files decoded at once. Each takes the memory of one image."""

TIFF_NAMES = (".tif", ".tiff")
PNG_SIGNATURE = b"\x89PNG\r\n\x1a\n"
JPEG_SIGNATURE, EXR_SIGNATURE = b"\xff\xd8", b"v/1\x01"
TIFF_SIGNATURES = (b"II*\0", b"MM\0*")
ORIENTATION = 274
"""Number of the tag of TIFF and Exif that says how viewers turn or mirror an image; 1: not at all."""

READ_FORMATS = "PNG, TIFF, JPEG, BMP, PGM or PPM"
"""Image formats that can be read, as text for people."""

Progress = Callable[[int, int], None]
"""Called with the number of files that are done and the number of all."""


@dataclass(frozen=True)
class PixelLocation:
    """Location of an image's pixels: in file `path` from byte `offset` on, row by row in C order."""

    path: Path
    offset: int
    dtype: str
    shape: tuple[int, ...]  # (H, W) or (H, W, 3)
    orientation: int = 1  # that of its file's tag; the pixels are as they are stored

    @property
    def kind(self) -> str:
        """Name of the type of the values, whatever their byte order."""
        return np.dtype(self.dtype).newbyteorder("=").name


@dataclass(frozen=True)
class FolderImages:
    """All images of a folder, of one size, type and number of channels, as a RowReader. It is picklable, since it holds
    names and locations only."""

    folder: Path
    names: tuple[str, ...]
    locations: tuple[PixelLocation, ...]
    stated_full_scale: float | None = None  # none: that of their type

    def __call__(self, image: int, start: int, stop: int) -> StoredValues:
        """Rows [start, stop) of one image. Raises RigError folder.invalid when the file is gone or cut short."""
        location = self.locations[image]
        kind, row = np.dtype(location.dtype), int(np.prod(location.shape[1:]))
        count = (stop - start) * row
        # Read instead of mapped: a map costs half a millisecond, and a file cut short would end the process.
        try:
            pixels = np.fromfile(location.path, kind, count, offset=location.offset + start * row * kind.itemsize)
        except OSError as error:
            raise refusal(location.path, f"is gone: {error}; restore it") from error
        if pixels.size < count:
            raise refusal(location.path, "was cut short while it was read: restore it")
        return pixels.reshape(stop - start, *location.shape[1:]).astype(kind.newbyteorder("="), copy=False)

    @property
    def size(self) -> tuple[int, int]:
        """Height and width."""
        height, width, *_ = self.locations[0].shape
        return height, width

    @property
    def channels(self) -> int:
        """1 or 3."""
        return 3 if len(self.locations[0].shape) == 3 else 1

    @property
    def kind(self) -> str:
        """Name of the type of the values."""
        return self.locations[0].kind

    @property
    def turned(self) -> list[str]:
        """Names of the images that viewers turn or mirror, by a tag in the file."""
        return [name for name, one in zip(self.names, self.locations, strict=True) if one.orientation != 1]

    @property
    def full_scale(self) -> float:
        """The stored value of 1.0."""
        return FULL_SCALE[self.kind] if self.stated_full_scale is None else self.stated_full_scale


def grey(image: np.ndarray) -> np.ndarray:
    """Brightness (H, W) of an image (H, W) or (H, W, 3) RGB, in the image's type (OpenCV, weights of BT.601)."""
    return cv2.cvtColor(image, cv2.COLOR_RGB2GRAY) if image.ndim == 3 else image


def open_images(
    folder: Path, names: Sequence[str], scratch: Path, black_level: int = 0, progress: Progress | None = None,
    full_scale: float | None = None,
) -> FolderImages:  # fmt: skip
    """Locates the pixels of the images that a list in the folder names; images are decoded if necessary.

    `black_level` is subtracted from each value, never below zero. `full_scale` is the stored value of 1.0, by default
    the type's.
    Raises RigError folder.invalid naming the file that is missing, damaged, or unlike the first one.
    """
    paths = [listed_file(folder, name) for name in names]
    for path in paths:
        if not path.is_file():
            raise refusal(path, "is missing: put the image there, or remove its row from the list")
    # Our own messages say what is wrong with a file, not OpenCV's.
    cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
    located: list[PixelLocation] = []
    with ThreadPoolExecutor(DECODER_THREADS) as pool:
        work = [pool.submit(_locate, path, scratch / f"{index}.raw", black_level) for index, path in enumerate(paths)]
        try:
            for path, future in zip(paths, work, strict=True):
                located.append(future.result())
                _refuse_mismatch(path, located[-1], paths[0], located[0])
                if progress is not None:
                    progress(len(located), len(paths))
        finally:
            for future in work:
                future.cancel()
    return FolderImages(folder, tuple(names), tuple(located), full_scale)


def decode(path: Path) -> np.ndarray:
    """Decodes one image file, (H, W) or (H, W, 3) RGB, as it is stored: in its type, whatever orientation it states.

    Raises RigError folder.invalid.
    """
    stored = content(path)
    if stored.startswith(PNG_SIGNATURE):  # OpenCV accepts some that are not intact
        try:
            PngImageFile(BytesIO(stored)).verify()
        except (OSError, SyntaxError, struct.error) as error:
            raise refusal(path, "is a damaged or truncated PNG file: copy it again") from error
    pixels = cv2.imdecode(np.frombuffer(stored, np.uint8), cv2.IMREAD_UNCHANGED) if stored else None
    if pixels is None and stored.startswith(EXR_SIGNATURE):
        raise refusal(path, f"is an OpenEXR image: save it as float32 TIFF (formats that can be read: {READ_FORMATS})")
    if pixels is None:
        raise refusal(
            path, f"is not an image in a format that can be read ({READ_FORMATS}), or is damaged: copy it again"
        )
    if stored.startswith(TIFF_SIGNATURES):  # which OpenCV turns; files of other formats it does not, so read
        pixels = np.ascontiguousarray(_as_stored(pixels, orientation(path)))
    return cv2.cvtColor(pixels, cv2.COLOR_BGR2RGB) if pixels.ndim == 3 and pixels.shape[2] == 3 else np.asarray(pixels)


def orientation(path: Path) -> int:
    """Reads how viewers turn or mirror a TIFF, JPEG or PNG file (1 to 8, as in Exif); 1: not at all, or not stated."""
    try:
        with path.open("rb") as file:
            signature = file.read(len(PNG_SIGNATURE))
            file.seek(0)
            if signature.startswith(TIFF_SIGNATURES):
                with tifffile.TiffFile(file) as tiff:
                    stated = tiff.pages.first.tags.valueof(ORIENTATION, 1)
            elif signature.startswith((PNG_SIGNATURE, JPEG_SIGNATURE)):
                image = (PngImageFile if signature == PNG_SIGNATURE else JpegImageFile)(file)
                exif = Exif()
                exif.load(image.info.get("exif", b""))
                stated = exif.get(ORIENTATION, 1)
            else:
                return 1
    except (OSError, SyntaxError, TypeError, ValueError, LookupError, struct.error, tifffile.TiffFileError):
        return 1  # a damaged tag states nothing; whether the pixels can be read, their decoder says
    return stated if stated in range(1, 9) else 1


def _as_stored(upright: np.ndarray, stated: int) -> np.ndarray:
    """Turns an image (H, W) or (H, W, C) back that was decoded upright, by the `stated` orientation of its file."""
    match stated:
        case 2:
            return upright[:, ::-1]
        case 3:
            return upright[::-1, ::-1]
        case 4:
            return upright[::-1]
        case 5:
            return upright.swapaxes(0, 1)
        case 6:
            return np.rot90(upright)
        case 7:
            return upright[::-1, ::-1].swapaxes(0, 1)
        case 8:
            return np.rot90(upright, -1)
        case _:
            return upright


def read_mask(path: Path, size: tuple[int, int]) -> BoolArray:
    """Reads a mask (H, W) of `size`: true where any channel is above zero, and alpha too, if there is one.

    Raises RigError folder.invalid when it is missing, empty, or of another size than the images.
    """
    pixels = _brightest_channel(decode(path))
    if pixels.shape != size:
        raise refusal(path, f"is {_size(pixels.shape)}, the images are {size[1]} × {size[0]}: use a mask of their size")
    if not np.any(pixels):
        raise refusal(path, "is empty: draw the object white on black")
    return pixels > 0


def grey_share(path: Path) -> float:
    """Share of a mask's object that is neither black nor white, that is, as bright as its brightest pixel."""
    pixels = _brightest_channel(decode(path))
    return float(np.mean(pixels[pixels > 0] < np.max(pixels))) if np.any(pixels) else 0.0


def _brightest_channel(pixels: np.ndarray) -> np.ndarray:
    """Values (H, W) of a mask: of its brightest channel, or of alpha where that is lower."""
    if pixels.ndim == 2:
        return pixels
    brightest = np.max(pixels[..., :3], axis=2)
    return np.minimum(brightest, pixels[..., 3]) if pixels.shape[2] == 4 else brightest


def _locate(path: Path, scratch: Path, black_level: int) -> PixelLocation:
    """Location of the pixels of one file, decoded into `scratch` unless it can be read in place."""
    if path.suffix.lower() in TIFF_NAMES:
        plain = _plain_tiff(path)
        if plain is not None and black_level == 0:
            return plain
    pixels = decode(path)
    _refuse_format(path, pixels.dtype, pixels.shape)
    if black_level:
        if pixels.dtype.kind == "u" and black_level >= np.iinfo(pixels.dtype).max:
            raise refusal(
                path,
                f"holds {8 * pixels.dtype.itemsize}-bit values, none of them above the black_level of {black_level}: "
                "correct black_level in lights.json",
            )
        pixels = np.maximum(cv2.subtract(pixels, np.full_like(pixels, black_level)), 0)
    try:
        with scratch.open("wb") as file:
            file.write(np.ascontiguousarray(pixels).data)
    except OSError as error:
        scratch.unlink(missing_ok=True)
        if error.errno in (errno.ENOSPC, errno.EDQUOT):
            raise RigError(
                ErrorCode.STORE_DISK_FULL,
                f"no space left in {scratch.parent} to unpack {path.name}: free some, or set TMPDIR to a larger disk",
                file=str(path),
            ) from error
        raise
    return PixelLocation(scratch, 0, pixels.dtype.name, pixels.shape, orientation(path))


def _plain_tiff(path: Path) -> PixelLocation | None:
    """Location of the pixels of an uncompressed TIFF file; None when it has to be decoded."""
    try:
        with tifffile.TiffFile(path) as file:
            if len(file.pages) != 1:
                raise refusal(path, f"holds {len(file.pages)} pages: save each image as a file of one page")
            page = file.pages.first
            if page.samplesperpixel > 1 and page.planarconfig != tifffile.PLANARCONFIG.CONTIG:
                raise refusal(path, "stores its channels as separate planes: save them interleaved")
            if page.dtype is None:
                raise refusal(path, "holds no pixels: save it again")
            if page.photometric == tifffile.PHOTOMETRIC.MINISWHITE:
                raise refusal(path, "stores white as 0 (MINISWHITE): save it with black as 0")
            if not page.is_contiguous or page.fillorder != 1:
                return None
            _refuse_format(path, page.dtype, page.shape)
            kind = page.dtype.newbyteorder(file.byteorder)
            shape = tuple(map(int, page.shape))
            location = PixelLocation(path, int(page.dataoffsets[0]), kind.str, shape, orientation(path))
    except (OSError, ValueError, LookupError, ArithmeticError, struct.error, tifffile.TiffFileError) as error:
        raise refusal(path, f"is not a TIFF file, or is damaged ({error}): copy it again") from error
    if path.stat().st_size < location.offset + int(np.prod(location.shape)) * kind.itemsize:
        raise refusal(path, "is a truncated TIFF file: copy it again")
    return location


def _refuse_format(path: Path, kind: np.dtype, shape: tuple[int, ...]) -> None:
    if kind.newbyteorder("=").name not in FULL_SCALE:
        raise refusal(path, f"holds {kind.name} values: save it as linear 16-bit (or 8-bit, or float32) values")
    if len(shape) not in (2, 3) or (len(shape) == 3 and shape[2] != 3):
        channels = shape[2] if len(shape) == 3 else shape
        raise refusal(path, f"has {channels} channels: save it as grey or RGB, without alpha")


def _refuse_mismatch(path: Path, image: PixelLocation, first: Path, other: PixelLocation) -> None:
    """Refuses an image of another size, number of channels or type than the `first` one."""
    if image.shape[:2] != other.shape[:2]:
        sizes = f"is {_size(image.shape)}, {first.name} is {_size(other.shape)}"
        raise refusal(path, f"{sizes}: use images of one size")
    if image.shape != other.shape:
        raise refusal(path, f"differs from {first.name} in its number of channels: save all as grey or all as RGB")
    if image.kind != other.kind:
        kinds = f"holds {image.kind} values, {first.name} {other.kind}"
        raise refusal(path, f"{kinds}: save all images with the same bit depth")


def _size(shape: tuple[int, ...]) -> str:
    return f"{shape[1]} × {shape[0]} pixels"
