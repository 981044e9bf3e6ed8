"""Recordings, poses and joints as a ROS 2 bag (MCAP), for the tools that read one, and such a bag as
a recording. Extra `ros`.

ROS counts lengths in metres and angles in radians (REP 103). Its optical frames have x right, y
down, z forward, as ours; a pixel's centre is where ours is. A bag that is written has

========================  =========================================  ==============================
topic                     message                                    what
========================  =========================================  ==============================
``/CAMERA/image``         ``sensor_msgs/msg/CompressedImage``        the frame, PNG, 8 bit grey
``/CAMERA/camera_info``   ``sensor_msgs/msg/CameraInfo``             matrix and lens
``/tf_static``            ``tf2_msgs/msg/TFMessage``                 ``world`` to each camera
``/handle_description``   ``std_msgs/msg/String``                    the handle file
``/handle_pose``          ``geometry_msgs/msg/``                     T_world_handle, without lost
                          ``PoseWithCovarianceStamped``              instants
``/tf``                   ``tf2_msgs/msg/TFMessage``                 ``world`` to ``handle``
``/joint_states``         ``sensor_msgs/msg/JointState``             the arm as it was measured
``/joint_commands``       ``sensor_msgs/msg/JointState``             as it was commanded
========================  =========================================  ==============================

The images' format is ``png``, the plain name that Foxglove wants; ROS's own decoder tells grey images by
their channels then. A stamp is the recording's time, from its own zero. A pose file has the traces of
the covariances of position and orientation: a third of them stands at each axis.
"""

from __future__ import annotations

import hashlib
import json
import logging
import shutil
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from heapq import merge
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform, Rotation
from tqdm import tqdm

from trinolab.camera import Camera, Rig, as_distortions
from trinolab.files import recording_writer
from trinolab.files.images import decoded
from trinolab.files.inputs import read_csv
from trinolab.files.journal import sole_writer, stamp
from trinolab.files.outputs import check_parent, resolved, write_whole
from trinolab.files.poses import read_poses, transforms
from trinolab.files.recording import Recording, instants, open_folder
from trinolab.files.rigs import handle_text, read_handle, read_rig
from trinolab.handle import Handle

from .reader import METADATA, opened

log = logging.getLogger("trinolab")

WORLD, HANDLE = "world", "handle"
MM = 1e-3  # of a metre
LATEST_S = 2**31  # what a stamp can say
LENS_MODELS = ("plumb_bob", "rational_polynomial")  # of 5 and of 8 distortions
IMAGES = ("sensor_msgs/msg/CompressedImage", "sensor_msgs/msg/Image")
# how others encode images: bytes of a pixel, and how OpenCV makes it grey, or blue, green and red
ENCODINGS = {
    **dict.fromkeys(("mono8", "8UC1"), (1, None)),
    **dict.fromkeys(("mono16", "16UC1"), (2, None)),
    **dict.fromkeys(("bgr8", "8UC3"), (3, None)),
    **dict.fromkeys(("bgra8", "8UC4"), (4, None)),
    "rgb8": (3, cv2.COLOR_RGB2BGR),
    "rgba8": (4, cv2.COLOR_RGBA2BGRA),
    "bayer_rggb8": (1, cv2.COLOR_BayerRGGB2GRAY),
    "bayer_bggr8": (1, cv2.COLOR_BayerBGGR2GRAY),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGBRG2GRAY),
    "bayer_grbg8": (1, cv2.COLOR_BayerGRBG2GRAY),
    **dict.fromkeys(("yuv422", "uyvy"), (2, cv2.COLOR_YUV2GRAY_UYVY)),
    **dict.fromkeys(("yuv422_yuy2", "yuyv"), (2, cv2.COLOR_YUV2GRAY_YUY2)),
}
TO_GREY = {3: cv2.COLOR_BGR2GRAY, 4: cv2.COLOR_BGRA2GRAY}  # by the channels
UNPACKED = ".unpacked"  # behind the name of a bag's recording folder, until the poses are written
LATCHED = ("/tf_static", "/handle_description")  # a reader that comes late gets them as well
MEASURED, COMMANDED, SPEED = "_measured_rad", "_rad", "_rad_s"


class Message(NamedTuple):
    """A message before it is written: time, ns, topic, and what it says."""

    time_ns: int
    topic: str
    content: Any


def write_bag(
    folder: str | Path,
    out: str | Path,
    poses: str | Path | None = None,
    joints: str | Path | None = None,
) -> dict[str, int]:
    """Write a recording folder, and what was measured and done with it, as a ROS 2 bag.

    Parameters
    ----------
    folder : path
        A recording folder with its rig and handle.
    out : path
        A folder that is not there yet: ``metadata.yaml`` and an MCAP file.
    poses : path, optional
        A pose file (CSV).
    joints : path, optional
        The arm's motion, as ``trinolab teleop`` writes it: a column ``t_s``, and for each joint
        its name with ``_rad``, ``_rad_s`` and ``_measured_rad``.

    Returns
    -------
    dict of str to int
        How many messages each topic has.

    Raises
    ------
    ValueError
        If the extra `ros` is missing, a file is missing or does not fit, a time is below zero, or
        `out` is there already.
    """
    target = resolved(out)
    check_parent(out)
    if target.exists() and not (target.is_dir() and not any(target.iterdir())):
        raise ValueError(f"{out}: exists already; name another folder, or remove it")
    recording, handle = open_folder(folder)
    ros = _ros()
    streams = [_described(recording.rig, handle, ros), _footage(recording, ros)]
    if poses is not None:
        streams.append(_poses(Path(poses), ros))
    if joints is not None:
        streams += _joints(Path(joints), ros)
    beside = target.with_name(f".{target.name}{recording_writer.PARTIAL}")
    with sole_writer(target, out):
        shutil.rmtree(beside, ignore_errors=True)  # of one that was killed
        try:
            counts = _write(merge(*streams, key=lambda one: one.time_ns), beside / target.name, ros)
            (beside / target.name).rename(target)
        except OSError as error:
            raise ValueError(f"{out}: cannot be written ({error.strerror})") from None
        finally:
            shutil.rmtree(beside, ignore_errors=True)
    return counts


def is_bag(path: str | Path) -> bool:
    """Whether something is a bag: an MCAP file, or a folder with ``metadata.yaml``."""
    path = Path(path)
    return (path.suffix == ".mcap" and path.is_file()) or (path / METADATA).is_file()


def track_recording(
    folder: str | Path,
    out: str | Path,
    rig: str | Path | None = None,
    handle: str | Path | None = None,
    timestamps: str | Path | None = None,
    **options: Any,
) -> pd.DataFrame:
    """Follow the handle through a recording folder or a bag, see `track_folder`.

    A bag is unpacked beside `out` until the poses are written.
    """
    # loaded here, because `write_bag` can do without the tracker
    from trinolab.following.track import track_folder

    if not is_bag(folder):
        return track_folder(folder, out, rig, handle, timestamps, **options)
    which = hashlib.sha256(json.dumps(stamp(Path(folder))).encode()).hexdigest()[:8]
    inside = Path(f"{out}.{which}{UNPACKED}")
    if not inside.exists():
        unpack_bag(folder, inside, None if rig is None else read_rig(rig), handle)
    try:
        return track_folder(inside, out, rig, handle, timestamps, **options)
    finally:
        shutil.rmtree(inside)


def unpack_bag(
    bag: str | Path,
    folder: str | Path,
    rig: Rig | None = None,
    handle: str | Path | None = None,
) -> None:
    """Write the images of a bag as a recording folder, which appears whole or not at all.

    A topic ``CAMERA/camera_info`` is a camera, with the one topic of images beneath ``CAMERA/``;
    where it stands says ``/tf_static``, by a chain of frames up to one that all cameras have. Images
    whose stamps are less than half a frame apart are one instant; its time is the mean of theirs. Where a
    camera lacks one, the instant is left out, and the log says so.

    Parameters
    ----------
    bag : path
        A folder with ``metadata.yaml``, or an MCAP file.
    folder : path
        A folder that is not there yet.
    rig : Rig, optional
        In the place of the bag's.
    handle : path, optional
        A handle file, in the place of the bag's ``/handle_description``.

    Raises
    ------
    ValueError
        Names the bag: not readable, no camera, no handle, a camera without images or without a
        place, images that no instant has in common, or that have no encoding that is known.
    """
    ros = _ros()
    given = None if handle is None else read_handle(handle)
    partial = recording_writer.partial_of(folder)
    shutil.rmtree(partial, ignore_errors=True)
    try:
        with opened(bag) as reader:
            the_rig = rig or _rig_of(reader, bag, ros)
            topics = {name: _images_of(reader, name, bag) for name in the_rig.names}
            the_handle = given or _handle_of(reader, bag, ros)
            recording_writer.begin(folder, the_rig, the_handle)
            times = [
                _unpack(reader, topic, partial, camera, bag, ros)
                for camera, topic in zip(the_rig.cameras, topics.values(), strict=True)
            ]
        instants_of, middle = _common(times, the_rig, bag)
        for camera, numbers in zip(the_rig.names, instants_of, strict=True):
            _keep(partial / "images" / camera, numbers.tolist())
        recording_writer.finish(folder, middle.tolist())
    finally:
        shutil.rmtree(partial, ignore_errors=True)


# Out


def _described(rig: Rig, handle: Handle, ros: Any) -> list[Message]:
    """What is said once: lenses, places, the handle."""
    static = [_transform(0, c.name, c.T_world_cam, ros) for c in rig.cameras]
    text = ros.types["std_msgs/msg/String"](handle_text(handle))
    return [
        *(Message(0, f"/{c.name}/camera_info", _camera_info(c, ros)) for c in rig.cameras),
        Message(0, "/tf_static", ros.types["tf2_msgs/msg/TFMessage"](static)),
        Message(0, "/handle_description", text),
    ]


def _footage(recording: Recording, ros: Any) -> Iterator[Message]:
    image_of = ros.types[IMAGES[0]]
    progress_bar = tqdm(instants(recording), total=recording.length, unit="instant", disable=None)
    for instant in progress_bar:
        time_ns = _nanoseconds(instant.t_s, "timestamps")
        for name, image in zip(recording.rig.names, instant.images, strict=True):
            grey = np.clip(np.round(image), 0, 255).astype(np.uint8)
            data = cv2.imencode(".png", grey, recording_writer.PNG)[1].ravel()
            content = image_of(_header(time_ns, name, ros), "png", data)
            yield Message(time_ns, f"/{name}/image", content)


def _poses(path: Path, ros: Any) -> Iterator[Message]:
    types = ros.types
    table = read_poses(path)
    table = table[table["status"] != "lost"]
    if table["t_s"].isna().any():
        raise ValueError(f"{path}: column 't_s' is empty; a bag needs the times of its poses")
    for row, T in zip(table.itertuples(), transforms(table), strict=True):
        time_ns = _nanoseconds(row.t_s, str(path))
        header = _header(time_ns, WORLD, ros)
        each = [(row.sigma_mm * MM) ** 2 / 3] * 3 + [np.radians(row.sigma_deg) ** 2 / 3] * 3
        pose = types["geometry_msgs/msg/Pose"](
            types["geometry_msgs/msg/Point"](*(T.translation * MM)), _quaternion(T, ros)
        )
        spread = np.nan_to_num(np.diag(each)).ravel()
        whole = types["geometry_msgs/msg/PoseWithCovariance"](pose, spread)
        stamped = types["geometry_msgs/msg/PoseWithCovarianceStamped"](header, whole)
        yield Message(time_ns, "/handle_pose", stamped)
        moved = types["tf2_msgs/msg/TFMessage"]([_transform(time_ns, HANDLE, T, ros)])
        yield Message(time_ns, "/tf", moved)


def _joints(path: Path, ros: Any) -> list[list[Message]]:
    """The two topics of the arm's motion."""
    table = read_csv(path)
    names = [str(c).removesuffix(MEASURED) for c in table.columns if str(c).endswith(MEASURED)]
    wanted = ["t_s", *(f"{name}{end}" for name in names for end in (COMMANDED, SPEED, MEASURED))]
    if missing := [name for name in wanted if name not in table.columns]:
        raise ValueError(f"{path}: column '{missing[0]}' is missing")
    if not names:
        raise ValueError(f"{path}: expected columns like shoulder{MEASURED}, got none")
    try:
        values = table[wanted].to_numpy(float)
    except ValueError:
        raise ValueError(f"{path}: expected numbers in all columns") from None
    if not np.isfinite(values).all():
        raise ValueError(f"{path}: expected finite numbers in all columns")
    state = ros.types["sensor_msgs/msg/JointState"]
    none = np.zeros(0)
    measured, commanded = [], []
    for t_s, *numbers in values:
        time_ns = _nanoseconds(t_s, str(path))
        header = _header(time_ns, "", ros)
        position, speed, now = np.array(numbers).reshape(-1, 3).T.copy()
        measured.append(Message(time_ns, "/joint_states", state(header, names, now, none, none)))
        commanded.append(
            Message(time_ns, "/joint_commands", state(header, names, position, speed, none))
        )
    return [measured, commanded]


def _write(messages: Iterator[Message], place: Path, ros: Any) -> dict[str, int]:
    """Write a bag, and say how many messages each topic has."""
    from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability
    from rosbags.interfaces import QosTime as Time
    from rosbags.rosbag2 import StoragePlugin, Writer

    ever = Time(0, 0)
    latched = Qos(
        QosHistory.KEEP_LAST,
        1,
        QosReliability.RELIABLE,
        QosDurability.TRANSIENT_LOCAL,
        ever,
        ever,
        QosLiveliness.SYSTEM_DEFAULT,
        ever,
        False,
    )
    connections: dict[str, Any] = {}
    counts: dict[str, int] = {}
    with Writer(place, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for time_ns, topic, content in messages:
            kind = content.__msgtype__
            if topic not in connections:
                lasting = topic in LATCHED or topic.endswith("/camera_info")
                connections[topic] = writer.add_connection(
                    topic, kind, typestore=ros, offered_qos_profiles=[latched] if lasting else []
                )
                counts[topic] = 0
            writer.write(connections[topic], time_ns, ros.serialize_cdr(content, kind))
            counts[topic] += 1
    return counts


def _camera_info(camera: Camera, ros: Any) -> Any:
    none = ros.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    width, height = camera.size
    K = np.asarray(camera.matrix, float)
    P = np.hstack([K, np.zeros((3, 1))])
    return ros.types["sensor_msgs/msg/CameraInfo"](
        header=_header(0, camera.name, ros),
        height=height,
        width=width,
        distortion_model=LENS_MODELS[len(camera.distortions) > 5],
        d=np.array(camera.distortions),
        k=K.ravel(),
        r=np.eye(3).ravel(),
        p=P.ravel(),
        binning_x=0,
        binning_y=0,
        roi=none,
    )


def _transform(time_ns: int, child: str, T: RigidTransform, ros: Any) -> Any:
    """T_world_child as a message."""
    types = ros.types
    moved = types["geometry_msgs/msg/Vector3"](*(T.translation * MM))
    turned = types["geometry_msgs/msg/Transform"](moved, _quaternion(T, ros))
    header = _header(time_ns, WORLD, ros)
    return types["geometry_msgs/msg/TransformStamped"](header, child, turned)


def _quaternion(T: RigidTransform, ros: Any) -> Any:
    return ros.types["geometry_msgs/msg/Quaternion"](*T.rotation.as_quat())


def _header(time_ns: int, frame: str, ros: Any) -> Any:
    stamp = ros.types["builtin_interfaces/msg/Time"](time_ns // 10**9, time_ns % 10**9)
    return ros.types["std_msgs/msg/Header"](stamp, frame)


def _nanoseconds(t_s: float, where: str) -> int:
    if not 0 <= t_s < LATEST_S:
        raise ValueError(f"{where}: expected times from 0 to 2^31 s for a bag, got {t_s:g}")
    return round(t_s * 1e9)


# In


def _messages(reader: Any, topic: str, ros: Any) -> Iterator[tuple[int, Any]]:
    """Time, ns, and content of the messages of a topic; the time is the stamp's if it has one."""
    for one in [c for c in reader.connections if c.topic == topic]:
        for connection, at_ns, data in reader.messages(connections=[one]):
            content = ros.deserialize_cdr(data, connection.msgtype)
            stamp = getattr(getattr(content, "header", None), "stamp", None)
            own_ns = 0 if stamp is None else stamp.sec * 10**9 + stamp.nanosec
            yield own_ns or at_ns, content


def _rig_of(reader: Any, bag: str | Path, ros: Any) -> Rig:
    """The rig that lenses and places of a bag make."""
    topics = sorted(
        c.topic for c in reader.connections if c.msgtype == "sensor_msgs/msg/CameraInfo"
    )
    if not topics:
        raise ValueError(f"{bag}: no camera in it (no topic of sensor_msgs/msg/CameraInfo)")
    places = {
        one.child_frame_id: one
        for _, content in _messages(reader, "/tf_static", ros)
        for one in content.transforms
    }
    cameras, chains = [], []
    for topic in topics:
        info = next((content for _, content in _messages(reader, topic, ros)), None)
        if info is None:
            raise ValueError(f"{bag}: {topic}: no message in it")
        chains.append(_chain(places, info.header.frame_id, bag))
        if len(chains[-1]) == 1 and not any(
            one.header.frame_id == info.header.frame_id for one in places.values()
        ):
            raise ValueError(
                f"{bag}: {topic}: /tf_static does not say where {info.header.frame_id!r} stands; "
                "give a rig file"
            )
        if info.distortion_model not in (*LENS_MODELS, ""):
            raise ValueError(
                f"{bag}: {topic}: expected the lens model {' or '.join(LENS_MODELS)}, got "
                f"{info.distortion_model!r}"
            )
        try:
            lens = as_distortions(np.asarray(info.d))
        except ValueError as error:
            raise ValueError(f"{bag}: {topic}: {error}") from None
        cameras.append(
            (
                topic.rpartition("/")[0].strip("/").replace("/", "_"),
                (info.width, info.height),
                np.reshape(info.k, (3, 3)),
                lens,
            )
        )
    common = [name for name in chains[0] if all(name in chain for chain in chains)]
    if not common:
        worlds = sorted({list(chain)[-1] for chain in chains})
        raise ValueError(
            f"{bag}: /tf_static: expected all cameras in one frame, got {', '.join(worlds)}; give a rig "
            "file"
        )
    places_of = [chain[common[0]].inv() for chain in chains]
    return Rig(tuple(Camera(*camera, T) for camera, T in zip(cameras, places_of, strict=True)))


def _chain(places: Mapping[str, Any], frame: str, bag: str | Path) -> dict[str, RigidTransform]:
    """Where a frame stands in itself, in its parent, in that one's parent, ...: T_parent_frame."""
    T = RigidTransform.identity()
    chain = {frame: T}
    while frame in places:
        T = _rigid(places[frame].transform) * T
        frame = places[frame].header.frame_id
        if frame in chain:
            raise ValueError(f"{bag}: /tf_static: {frame!r} stands in itself")
        chain[frame] = T
    return chain


def _rigid(transform: Any) -> RigidTransform:
    moved, turned = transform.translation, transform.rotation
    return RigidTransform.from_components(
        np.array([moved.x, moved.y, moved.z]) / MM,
        Rotation.from_quat([turned.x, turned.y, turned.z, turned.w]),
    )


def _images_of(reader: Any, camera: str, bag: str | Path) -> str:
    """The topic of a camera's images."""
    topics = {
        c.topic
        for c in reader.connections
        if c.msgtype in IMAGES and c.topic.strip("/").replace("/", "_").startswith(f"{camera}_")
    }
    if len(topics) != 1:
        what = " and ".join(sorted(topics)) or "none"
        raise ValueError(f"{bag}: expected one topic of images of camera {camera}, got {what}")
    return topics.pop()


def _handle_of(reader: Any, bag: str | Path, ros: Any) -> Handle:
    """The handle that a bag describes."""
    text = next((content.data for _, content in _messages(reader, "/handle_description", ros)), "")
    if not text:
        raise ValueError(f"{bag}: no handle in it (/handle_description); give a handle file")
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "handle.toml")
        write_whole(file, text)
        try:
            return read_handle(file)
        except ValueError as error:
            what = str(error).removeprefix(f"{file}: ")
            raise ValueError(f"{bag}: /handle_description: {what}") from None


def _unpack(
    reader: Any, topic: str, partial: Path, camera: Camera, bag: str | Path, ros: Any
) -> np.ndarray:
    """Write a camera's images, and return their times, s."""
    times: list[float] = []
    for time_ns, content in tqdm(_messages(reader, topic, ros), unit="image", disable=None):
        image, complaint = _decoded(content, f"{bag}: {topic}: image {len(times)}")
        if complaint:
            log.info("%s: %s: image %d: may be damaged (%s)", bag, topic, len(times), complaint)
        if image is None or image.shape[:2] != (camera.size[1], camera.size[0]):
            encoding = getattr(content, "encoding", getattr(content, "format", ""))
            size = f"{image.shape[1]} x {image.shape[0]} of " if image is not None else ""
            raise ValueError(
                f"{bag}: {topic}: image {len(times)}: expected {camera.size[0]} x {camera.size[1]} "
                f"pixels of grey or colour, got {size}{encoding!r}"
            )
        if image.ndim == 3:
            image = cv2.cvtColor(image, TO_GREY[image.shape[2]])
        recording_writer.write_image(
            image, partial / "images" / camera.name / f"{len(times):06d}.png"
        )
        times.append(time_ns * 1e-9)
    return np.array(times)


def _decoded(content: Any, where: str) -> tuple[np.ndarray | None, str]:
    """The image that a message holds, None if it cannot be decoded, and what its decoder has to
    say.
    """
    if content.__msgtype__ == IMAGES[0]:
        image, complaint = decoded(bytes(content.data), where)
        deep = image is not None and image.dtype in (np.uint8, np.uint16)
        return (image if deep else None), complaint
    of_pixel, conversion = ENCODINGS.get(content.encoding, (0, None))
    wide = content.width * of_pixel
    if not 0 < wide <= content.step or len(content.data) < content.height * content.step:
        return None, ""
    rows = np.reshape(content.data[: content.height * content.step], (content.height, -1))
    image = np.ascontiguousarray(rows[:, :wide])
    if content.encoding in ("mono16", "16UC1"):
        return image.view(">u2" if content.is_bigendian else "<u2").astype(np.uint16), ""
    if of_pixel > 1:
        image = image.reshape(content.height, content.width, of_pixel)
    return (image if conversion is None else cv2.cvtColor(image, conversion)), ""


def _common(
    times: Sequence[np.ndarray], rig: Rig, bag: str | Path
) -> tuple[list[np.ndarray], np.ndarray]:
    """The instants that all cameras have: the numbers of each camera's images, and their times, s;
    ValueError where these are half of the images or fewer.
    """
    counts = [len(one) for one in times]
    what = ", ".join(f"{name} {n}" for name, n in zip(rig.names, counts, strict=True))
    unequal = f"{bag}: expected as many images of each camera, and one at least: {what}"
    if min(counts) == 0:
        raise ValueError(unequal)
    fewest = times[int(np.argmin(counts))]
    step = min((np.median(np.diff(one)) for one in times if len(one) > 1), default=np.inf)
    numbers = [np.searchsorted((one[1:] + one[:-1]) / 2, fewest) for one in times]
    every = np.array([one[k] for one, k in zip(times, numbers, strict=True)])
    apart = np.ptp(every, axis=0)
    fits = (apart <= step / 2) & np.all(np.diff(numbers, prepend=-1) > 0, axis=0)
    if 2 * fits.sum() <= max(counts):
        if len(set(counts)) > 1:
            raise ValueError(unequal)
        raise ValueError(
            f"{bag}: instant {int(fits.argmin())}: the cameras' images are {apart.max():.3g} s apart, more "
            "than half a frame"
        )
    if missing := max(counts) - int(fits.sum()):
        log.info(
            "%s: %d instants left out, of which a camera has no image (%s)", bag, missing, what
        )
    return [k[fits] for k in numbers], every.mean(axis=0)[fits]


def _keep(folder: Path, numbers: Sequence[int]) -> None:
    """Keep some of a camera's images, numbered from 0."""
    for k, number in enumerate(numbers):
        (folder / f"{number:06d}.png").replace(folder / f"{k:06d}.png")
    for path in sorted(folder.iterdir())[len(numbers) :]:
        path.unlink()


def _ros() -> Any:
    """The messages of ROS 2; ValueError without the extra."""
    try:
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise ValueError("a ROS 2 bag needs rosbags: pip install 'trinolab[ros]'") from None
    return get_typestore(Stores.ROS2_JAZZY)
