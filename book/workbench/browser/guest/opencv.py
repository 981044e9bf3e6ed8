"""``cv2`` in the browser: the calls that the packages and the chapters make, under their names.

Most go to OpenCV.js, a call each through the door. What is a line of NumPy stays here, and what
OpenCV.js lacks has a form in NumPy where a chapter needs it: these say so. Any other name raises
NotImplementedError when it is called.
"""

from __future__ import annotations

import io
import types
from collections.abc import Sequence
from typing import Any

import numpy as np

from . import door, lacking

OUT = {"out": 1}
OUTS = {"outs": 1}


class error(Exception):  # noqa: N801, N818  OpenCV's own name
    """OpenCV could not do it."""


def __getattr__(name: str) -> Any:
    """A constant of OpenCV.js, or a function that says that it is missing."""
    if name.startswith("__"):
        raise AttributeError(name)
    if name.isupper() or name[:3] == "CV_":
        value = door.ask({"asks": "constant", "name": name})[0]["value"]
        if value is None:
            raise AttributeError(f"OpenCV.js has no constant {name}")
        globals()[name] = value
        return value
    return _missing(name)


def _missing(name: str) -> Any:
    def refuse(*_: Any, **__: Any) -> None:
        raise NotImplementedError(f"OpenCV.js, which runs in this page, has no cv2.{name}")

    return refuse


def _call(name: str, *given: Any) -> tuple[Any, list[np.ndarray], list[int]]:
    """Call a function of OpenCV.js: what it returned, the matrices it filled, the lengths of lists."""
    arrays: list[np.ndarray] = []

    def place(array: Any) -> int:
        array = np.asarray(array)
        arrays.append(np.ascontiguousarray(array.view(np.uint8) if array.dtype == bool else array))
        return len(arrays) - 1

    def described(one: Any) -> Any:
        if isinstance(one, np.ndarray):
            return {"array": place(one)}
        if isinstance(one, np.generic):
            return one.item()
        if isinstance(one, _Changed):
            return {"inout": place(one.array)}
        if isinstance(one, _Several):
            return {"vector": [place(array) for array in one.arrays]}
        return one

    about = [described(one) for one in given]
    try:
        answer, results = door.ask({"asks": "opencv", "name": name, "arguments": about}, arrays)
    except RuntimeError as problem:
        raise error(f"{name}: {problem}") from None
    values = answer["values"]
    return values["returned"], results, values["counts"]


class _Changed:
    """A matrix that the call changes."""

    def __init__(self, array: np.ndarray) -> None:
        self.array = array


class _Several:
    """Matrices that go as a list."""

    def __init__(self, arrays: Sequence[Any]) -> None:
        self.arrays = arrays


def _size(size: Any) -> dict[str, Any]:
    return {"size": [0, 0] if size is None else [int(side) for side in size]}


def _point(point: Any) -> dict[str, Any]:
    return {"point": [float(value) for value in point]}


def _whole_point(point: Any) -> dict[str, Any]:
    return {"point": [int(value) for value in point]}


def _scalar(value: Any) -> dict[str, Any]:
    values = [float(one) for one in np.ravel(value)]
    return {"scalar": (values + [0.0] * 4)[:4]}


def _into(dst: np.ndarray | None, result: np.ndarray) -> np.ndarray:
    if dst is None or dst.shape != result.shape or dst.dtype != result.dtype:
        return result
    dst[...] = result
    return dst


def _filled(name: str, *given: Any, dst: np.ndarray | None = None) -> np.ndarray:
    """Call a function that fills one matrix."""
    return _into(dst, _call(name, *given)[1][0])


# Filters and shapes


def _by_kernel(name: str, src: Any, kernel: Any, dst: Any, iterations: int) -> np.ndarray:
    kernel = np.ones((3, 3), np.uint8) if kernel is None else kernel
    return _filled(name, src, OUT, kernel, _whole_point((-1, -1)), iterations, dst=dst)


def dilate(src: Any, kernel: Any, dst: Any = None, anchor: Any = None, iterations: int = 1) -> Any:
    return _by_kernel("dilate", src, kernel, dst, iterations)


def erode(src: Any, kernel: Any, dst: Any = None, anchor: Any = None, iterations: int = 1) -> Any:
    return _by_kernel("erode", src, kernel, dst, iterations)


def blur(src: Any, ksize: Any, dst: Any = None) -> Any:
    return _filled("blur", src, OUT, _size(ksize), dst=dst)


def medianBlur(src: Any, ksize: int, dst: Any = None) -> Any:
    return _filled("medianBlur", src, OUT, ksize, dst=dst)


def GaussianBlur(
    src: Any, ksize: Any, sigmaX: float, dst: Any = None, sigmaY: float = 0, borderType: int = 4
) -> Any:
    return _filled("GaussianBlur", src, OUT, _size(ksize), sigmaX, sigmaY, borderType, dst=dst)


def getStructuringElement(shape: int, ksize: Any) -> Any:
    sides = {"size": [int(side) for side in ksize]}
    return door.ask(
        {"asks": "opencv", "name": "getStructuringElement", "arguments": [shape, sides]}
    )[1][0]


def resize(
    src: Any, dsize: Any, dst: Any = None, fx: float = 0, fy: float = 0, interpolation: int = 1
) -> Any:
    return _filled("resize", src, OUT, _size(dsize), fx, fy, interpolation, dst=dst)


def warpAffine(
    src: Any,
    M: Any,
    dsize: Any,
    dst: Any = None,
    flags: int = 1,
    borderMode: int = 0,
    borderValue: Any = 0,
) -> Any:
    M = np.asarray(M, float)
    return _filled(
        "warpAffine", src, OUT, M, _size(dsize), flags, borderMode, _scalar(borderValue), dst=dst
    )


def remap(
    src: Any,
    map1: Any,
    map2: Any,
    interpolation: int,
    dst: Any = None,
    borderMode: int = 0,
    borderValue: Any = 0,
) -> Any:
    return _filled(
        "remap", src, OUT, map1, map2, interpolation, borderMode, _scalar(borderValue), dst=dst
    )


def getRectSubPix(
    image: Any, patchSize: Any, center: Any, patch: Any = None, patchType: int = -1
) -> Any:
    return _filled(
        "getRectSubPix", image, _size(patchSize), _point(center), OUT, patchType, dst=patch
    )


def cvtColor(src: Any, code: int, dst: Any = None) -> Any:
    return _filled("cvtColor", src, OUT, code, dst=dst)


def threshold(src: Any, thresh: float, maxval: float, type: int, dst: Any = None) -> Any:
    returned, results, _ = _call("threshold", src, OUT, thresh, maxval, type)
    return returned, _into(dst, results[0])


def copyMakeBorder(
    src: np.ndarray, top: int, bottom: int, left: int, right: int, borderType: int, value: Any = 0
) -> np.ndarray:
    modes = {0: "constant", 1: "edge", 2: "symmetric", 4: "reflect"}
    sides = [(top, bottom), (left, right)] + [(0, 0)] * (src.ndim - 2)
    more = {"constant_values": value} if borderType == 0 else {}
    return np.pad(src, sides, modes[borderType], **more)  # type: ignore[call-overload]


# Lines of NumPy


def min(first: Any, second: Any, dst: Any = None) -> Any:
    return np.minimum(first, second, out=dst)


def max(first: Any, second: Any, dst: Any = None) -> Any:
    return np.maximum(first, second, out=dst)


def subtract(first: np.ndarray, second: Any, dst: Any = None) -> Any:
    if first.dtype == np.uint8:
        return np.clip(first.astype(np.int16) - second, 0, 255).astype(np.uint8)
    return first - second


def absdiff(first: np.ndarray, second: np.ndarray) -> Any:
    return np.maximum(first, second) - np.minimum(first, second)


def compare(first: np.ndarray, second: Any, cmpop: int) -> np.ndarray:
    operator = (np.equal, np.greater, np.greater_equal, np.less, np.less_equal, np.not_equal)[cmpop]
    return operator(first, second).view(np.uint8) * np.uint8(255)


def split(image: np.ndarray) -> tuple[np.ndarray, ...]:
    return tuple(np.ascontiguousarray(image[..., k]) for k in range(image.shape[2]))


def mean(src: np.ndarray, mask: np.ndarray | None = None) -> tuple[float, ...]:
    values = src if mask is None else src[mask != 0]
    return (float(values.mean(dtype=float)) if values.size else 0.0, 0.0, 0.0, 0.0)


def accumulateWeighted(src: np.ndarray, dst: np.ndarray, alpha: float) -> np.ndarray:
    dst[...] = dst * dst.dtype.type(1 - alpha) + src * dst.dtype.type(alpha)
    return dst


# Shapes in a mask


def connectedComponents(
    image: Any, labels: Any = None, connectivity: int = 8, ltype: int = 4
) -> Any:
    returned, results, _ = _call("connectedComponents", image, OUT, connectivity, ltype)
    return returned, _into(labels, results[0])


def connectedComponentsWithStats(image: Any, connectivity: int = 8, ltype: int = 4) -> Any:
    returned, results, _ = _call(
        "connectedComponentsWithStats", image, OUT, OUT, OUT, connectivity, ltype
    )
    return (returned, *results)


def connectedComponentsWithStatsWithAlgorithm(
    image: Any, connectivity: int, ltype: int, ccltype: int
) -> Any:
    """OpenCV.js has one algorithm; all give the same components."""
    return connectedComponentsWithStats(image, connectivity, ltype)


def findContours(image: Any, mode: int, method: int, offset: Any = (0, 0)) -> Any:
    _, results, counts = _call("findContours", image, OUTS, OUT, mode, method, _whole_point(offset))
    return tuple(results[: counts[0]]), (results[counts[0]] if counts[0] else None)


def convexHull(points: Any) -> Any:
    return _filled("convexHull", points, OUT)


def moments(array: Any, binaryImage: bool = False) -> dict[str, float]:
    return dict(_call("moments", array, binaryImage)[0])


def boundingRect(array: Any) -> tuple[int, int, int, int]:
    array = np.asarray(array)
    if array.dtype == np.uint8:
        rows, columns = np.flatnonzero(array.any(1)), np.flatnonzero(array.any(0))
        if len(rows) == 0:
            return 0, 0, 0, 0
    else:
        columns, rows = np.floor(array.reshape(-1, 2)).astype(int).T
    u, v = int(columns.min()), int(rows.min())
    return u, v, int(columns.max()) - u + 1, int(rows.max()) - v + 1


# Drawing, into the image that is given


def _drawn(name: str, image: np.ndarray, *given: Any) -> np.ndarray:
    image[...] = _call(name, _Changed(image), *given)[1][0].reshape(image.shape)
    return image


def circle(
    img: Any,
    center: Any,
    radius: int,
    color: Any,
    thickness: int = 1,
    lineType: int = 8,
    shift: int = 0,
) -> Any:
    place = _whole_point(center)
    return _drawn("circle", img, place, int(radius), _scalar(color), thickness, lineType, shift)


def line(
    img: Any, pt1: Any, pt2: Any, color: Any, thickness: int = 1, lineType: int = 8, shift: int = 0
) -> Any:
    ends = _whole_point(pt1), _whole_point(pt2)
    return _drawn("line", img, *ends, _scalar(color), thickness, lineType, shift)


def rectangle(
    img: Any, pt1: Any, pt2: Any, color: Any, thickness: int = 1, lineType: int = 8, shift: int = 0
) -> Any:
    ends = _whole_point(pt1), _whole_point(pt2)
    return _drawn("rectangle", img, *ends, _scalar(color), thickness, lineType, shift)


def arrowedLine(
    img: Any,
    pt1: Any,
    pt2: Any,
    color: Any,
    thickness: int = 1,
    line_type: int = 8,
    shift: int = 0,
    tipLength: float = 0.1,
) -> Any:
    ends = _whole_point(pt1), _whole_point(pt2)
    more = thickness, line_type, shift, tipLength
    return _drawn("arrowedLine", img, *ends, _scalar(color), *more)


def getTextSize(text: str, fontFace: int, fontScale: float, thickness: int) -> Any:
    """Width and height of what `putText` draws, looked at: OpenCV.js does not say them."""
    base = 50
    paper = np.zeros((2 * base, 60 * (len(text) + 1)), np.uint8)
    putText(paper, text, (0, base), fontFace, fontScale, 255, thickness)
    u, v, width, _ = boundingRect(paper)
    return (u + width, base - v), 0


def drawMarker(
    img: Any,
    position: Any,
    color: Any,
    markerType: int = 0,
    markerSize: int = 20,
    thickness: int = 1,
    line_type: int = 8,
) -> Any:
    place = _whole_point(position)
    return _drawn(
        "drawMarker", img, place, _scalar(color), markerType, markerSize, thickness, line_type
    )


def putText(
    img: Any,
    text: str,
    org: Any,
    fontFace: int,
    fontScale: float,
    color: Any,
    thickness: int = 1,
    lineType: int = 8,
) -> Any:
    place = _whole_point(org)
    return _drawn(
        "putText", img, text, place, fontFace, fontScale, _scalar(color), thickness, lineType
    )


def fillPoly(
    img: Any,
    pts: Sequence[Any],
    color: Any,
    lineType: int = 8,
    shift: int = 0,
    offset: Any = (0, 0),
) -> Any:
    return _drawn(
        "fillPoly", img, _Several(pts), _scalar(color), lineType, shift, _whole_point(offset)
    )


def fillConvexPoly(img: Any, points: Any, color: Any, lineType: int = 8, shift: int = 0) -> Any:
    return _drawn("fillConvexPoly", img, np.asarray(points), _scalar(color), lineType, shift)


# Cameras


def _distortions(distCoeffs: Any) -> np.ndarray:
    return np.zeros((0, 0)) if distCoeffs is None else np.asarray(distCoeffs, float)


def Rodrigues(src: Any) -> Any:
    _, results, _ = _call("Rodrigues", np.asarray(src, float), OUT, OUT)
    return results[0], results[1]


def solvePnP(
    objectPoints: Any,
    imagePoints: Any,
    cameraMatrix: Any,
    distCoeffs: Any,
    rvec: Any = None,
    tvec: Any = None,
    useExtrinsicGuess: bool = False,
    flags: int = 0,
) -> Any:
    start = [
        _Changed(np.zeros((3, 1)) if one is None else np.asarray(one, float).reshape(3, 1))
        for one in (rvec, tvec)
    ]
    returned, results, _ = _call(
        "solvePnP",
        np.asarray(objectPoints),
        np.asarray(imagePoints),
        np.asarray(cameraMatrix, float),
        _distortions(distCoeffs),
        *start,
        useExtrinsicGuess,
        flags,
    )
    return bool(returned), results[0], results[1]


def solvePnPRefineLM(
    objectPoints: Any, imagePoints: Any, cameraMatrix: Any, distCoeffs: Any, rvec: Any, tvec: Any
) -> Any:
    _, results, _ = _call(
        "solvePnPRefineLM",
        np.asarray(objectPoints),
        np.asarray(imagePoints),
        np.asarray(cameraMatrix, float),
        _distortions(distCoeffs),
        _Changed(rvec),
        _Changed(tvec),
    )
    return results[0], results[1]


def triangulatePoints(projMatr1: Any, projMatr2: Any, projPoints1: Any, projPoints2: Any) -> Any:
    """By `lacking.triangulated`."""
    given = (projMatr1, projMatr2, projPoints1, projPoints2)
    return lacking.triangulated(*(np.asarray(one, float) for one in given))


def findCirclesGrid(
    image: Any, patternSize: Any, flags: int = 1, blobDetector: Any = None
) -> tuple[bool, np.ndarray | None]:
    """By `lacking.four_of_a_grid`: of two by two, by clusters."""
    clustered = flags & __getattr__("CALIB_CB_CLUSTERING")
    if tuple(patternSize) != (2, 2) or not clustered:
        _missing("findCirclesGrid but for two by two, by clusters")()
    detector = SimpleBlobDetector() if blobDetector is None else blobDetector
    points = np.array([one.pt for one in detector.detect(image)], float).reshape(-1, 2)
    four = lacking.four_of_a_grid(points)
    return four is not None, None if four is None else four.astype(np.float32)[:, None]


def stereoCalibrate(
    objectPoints: Any,
    imagePoints1: Any,
    imagePoints2: Any,
    cameraMatrix1: Any,
    distCoeffs1: Any,
    cameraMatrix2: Any,
    distCoeffs2: Any,
    imageSize: Any,
    flags: int = 0,
    criteria: Any = None,
) -> Any:
    """By `lacking.stereo_pair`: without distortion, the lenses fitted or kept."""
    if np.any(distCoeffs1) or np.any(distCoeffs2) or not flags & __getattr__("CALIB_FIX_K1"):
        _missing("stereoCalibrate with distortion")()
    points = [np.asarray(one, float).reshape(-1, 3) for one in objectPoints]
    uv = [
        [np.asarray(one, float).reshape(-1, 2) for one in views]
        for views in (imagePoints1, imagePoints2)
    ]
    matrices = np.asarray(cameraMatrix1, float), np.asarray(cameraMatrix2, float)
    in_first, in_second = (
        [solvePnP(points[k], view, K, None)[1:] for k, view in enumerate(views)]
        for views, K in zip(uv, matrices, strict=True)
    )
    turns = [Rodrigues(rvec)[0] for rvec, _ in (in_first[0], in_second[0])]
    turn = turns[1] @ turns[0].T
    shift = in_second[0][1] - turn @ in_first[0][1]
    free = bool(flags & __getattr__("CALIB_USE_INTRINSIC_GUESS"))
    pair = lacking.stereo_pair(points, uv, matrices, in_first, (Rodrigues(turn)[0], shift), free)
    none = np.zeros((5, 1))
    return pair.rms, pair.first, none, pair.second, none, pair.R, pair.T, None, None


def calibrateCamera(
    objectPoints: Any,
    imagePoints: Any,
    imageSize: Any,
    cameraMatrix: Any,
    distCoeffs: Any,
    flags: int = 0,
    criteria: Any = (3, 30, 2.2e-16),
) -> Any:
    camera = np.zeros((3, 3)) if cameraMatrix is None else np.asarray(cameraMatrix, float).copy()
    start = np.zeros((5, 1)) if distCoeffs is None else np.asarray(distCoeffs, float).reshape(-1, 1)
    views = [_Several([np.asarray(view) for view in one]) for one in (objectPoints, imagePoints)]
    returned, results, counts = _call(
        "calibrateCameraExtended",
        *views,
        _size(imageSize),
        _Changed(camera),
        _Changed(start),
        OUTS,
        OUTS,
        OUT,
        OUT,
        OUT,
        flags,
        {"criteria": list(criteria)},
    )
    count = counts[0]
    turns, shifts = tuple(results[2 : 2 + count]), tuple(results[2 + count : 2 + 2 * count])
    lens = results[1] if distCoeffs is None else results[1].reshape(np.shape(distCoeffs))
    return returned, results[0], lens, turns, shifts


# Files, through Pillow


def imdecode(buf: Any, flags: int) -> np.ndarray | None:
    from PIL import Image, UnidentifiedImageError

    try:
        file = Image.open(io.BytesIO(np.asarray(buf).tobytes()))
        file.load()
    except (UnidentifiedImageError, OSError, SyntaxError):
        return None
    other = {"P": "RGB", "1": "L"}.get(file.mode)
    image = file.convert(other) if other else file
    values = np.asarray(image)
    if values.dtype == np.int32:
        values = values.astype(np.uint16)
    if values.ndim == 3:
        values = values[..., [2, 1, 0, 3][: values.shape[2]]]
    return values if flags != 0 or values.ndim == 2 else cvtColor(values, 6)


def imencode(ext: str, img: np.ndarray, params: Any = None) -> tuple[bool, np.ndarray]:
    from PIL import Image

    file = io.BytesIO()
    ordered = img if img.ndim == 2 else img[..., [2, 1, 0, 3][: img.shape[2]]]
    kind = {".png": "PNG", ".jpg": "JPEG", ".jpeg": "JPEG"}[ext]
    asked = dict(zip(params[::2], params[1::2], strict=True)) if params else {}
    more = {"PNG": {"compress_level": asked.get(IMWRITE_PNG_COMPRESSION, 1)},
            "JPEG": {"quality": asked.get(IMWRITE_JPEG_QUALITY, 95)}}  # fmt: skip
    Image.fromarray(np.ascontiguousarray(ordered)).save(file, kind, **more[kind])
    return True, np.frombuffer(file.getvalue(), np.uint8)


# What has a state on the other side


class SimpleBlobDetector_Params:  # noqa: N801  OpenCV's own name
    """Any field may be set; those that are not keep OpenCV's values."""


class KeyPoint:
    """A blob: its centre and size, px."""

    def __init__(self, pt: tuple[float, float], size: float) -> None:
        self.pt = pt
        self.size = size


class SimpleBlobDetector:
    """OpenCV's detector of blobs."""

    def __init__(self, params: Any = None) -> None:
        self._params = {} if params is None else dict(vars(params))

    create = classmethod(lambda cls, params=None: cls(params))

    def detect(self, image: np.ndarray) -> tuple[KeyPoint, ...]:
        answer, _ = door.ask(
            {"asks": "blobs", "parameters": self._params}, [np.ascontiguousarray(image)]
        )
        return tuple(KeyPoint((u, v), size) for u, v, size in answer["points"])


SimpleBlobDetector_create = SimpleBlobDetector


class BackgroundSubtractorMOG2:
    """OpenCV's mixture of Gaussians; it lives on the other side of the door."""

    def __init__(self, *given: Any) -> None:
        self._number = door.ask({"asks": "mixture", "given": given})[0]["number"]

    def apply(self, image: np.ndarray, fgmask: Any = None, learningRate: float = -1) -> np.ndarray:
        about = {"asks": "mixture", "number": self._number, "rate": learningRate}
        return door.ask(about, [np.ascontiguousarray(image)])[1][0]


def createBackgroundSubtractorMOG2(
    history: int = 500, varThreshold: float = 16.0, detectShadows: bool = True
) -> BackgroundSubtractorMOG2:
    return BackgroundSubtractorMOG2(history, varThreshold, detectShadows)


class VideoCapture:
    """Reads no film."""

    def __init__(self, *_: Any) -> None:
        pass

    def isOpened(self) -> bool:
        return False

    def release(self) -> None:
        pass


class VideoWriter:
    """Writes no film: no encoder is there."""

    fourcc = staticmethod(lambda *_: 0)

    def __init__(self, *_: Any) -> None:
        raise NotImplementedError("no film can be written in this page")


CAP_FFMPEG, CAP_PROP_POS_FRAMES, CAP_PROP_FPS, CAP_PROP_FRAME_COUNT = 1900, 1, 5, 7
CAP_PROP_FRAME_WIDTH, CAP_PROP_FRAME_HEIGHT = 3, 4
CCL_WU = 0
TERM_CRITERIA_COUNT, TERM_CRITERIA_EPS = 1, 2
IMREAD_UNCHANGED, IMREAD_GRAYSCALE, IMREAD_COLOR = -1, 0, 1
IMWRITE_JPEG_QUALITY, IMWRITE_PNG_COMPRESSION, IMWRITE_PNG_STRATEGY = 1, 16, 17
IMWRITE_PNG_FILTER, IMWRITE_PNG_FILTER_NONE, IMWRITE_PNG_STRATEGY_RLE = 19, 8, 3


def setNumThreads(nthreads: int) -> None:
    pass


def getNumThreads() -> int:
    return 1


class _Aruco(types.ModuleType):
    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return _missing(f"aruco.{name}")


aruco = _Aruco("cv2.aruco")
utils = types.SimpleNamespace(
    logging=types.SimpleNamespace(setLogLevel=lambda level: level, LOG_LEVEL_ERROR=2)
)
