"""A recording as a ROS 2 bag, read back by another reader (mcap), and tracked from it."""

import re
import shutil
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from healthy import run
from scipy.spatial.transform import RigidTransform, Rotation

from satellites.bags.bags import ENCODINGS, unpack_bag, write_bag
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.camera import Camera, Rig
from trinolab.datasets import load_handle, paper_rig
from trinolab.files import recording_writer
from trinolab.files.images import read_greys
from trinolab.files.outputs import table_text
from trinolab.files.poses import pose_table, write_poses
from trinolab.files.recording import open_folder
from trinolab.files.rigs import handle_text, read_rig, write_handle, write_rig
from trinolab.pose import LOST, Pose
from workbench.cli import main

rosbags = pytest.importorskip("rosbags.rosbag2", reason="extra ros is not installed")

RIG = paper_rig(40.0)
CODED = load_handle("coded")
COUNT, FPS = 3, 30
TURN = Rotation.from_euler("ZYX", [-30, 10, 20], degrees=True)
POSES = [RigidTransform.from_components([2.0 * k, 5.0, 549.0], TURN) for k in range(COUNT)]
JOINTS = pd.DataFrame(
    {
        "t_s": [0.0, 0.002],
        "elbow_rad": [0.1, 0.2],
        "wrist_rad": [1.1, 1.2],
        "elbow_rad_s": [0.5, 0.6],
        "wrist_rad_s": [1.5, 1.6],
        "elbow_measured_rad": [0.11, 0.21],
        "wrist_measured_rad": [1.11, 1.21],
    }
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A recording with its poses, the last of them lost, and the arm's motion."""
    root, rng = tmp_path_factory.mktemp("bags") / "r", np.random.default_rng(0)
    partial = recording_writer.begin(root, RIG, CODED)
    for k, T in enumerate(POSES):
        recording_writer.add(partial, RIG, k, render_rig(RIG, CODED, T, Bench(), rng))
    recording_writer.finish(root, np.arange(COUNT) / FPS)
    covariance = np.diag([0.03, 0.03, 0.03, 1e-4, 1e-4, 1e-4])
    poses = [Pose("measured", T, covariance, 0.1, 6, 3) for T in POSES[:-1]]
    table = pose_table([*poses, LOST], np.arange(COUNT) / FPS)
    write_poses(table, root.parent / "poses.csv")
    JOINTS.to_csv(root.parent / "joints.csv", index=False)
    return root


@pytest.fixture(scope="module")
def bag(folder):
    out = folder.parent / "bag"
    write_bag(folder, out, folder.parent / "poses.csv", folder.parent / "joints.csv")
    return out


@pytest.fixture(scope="module")
def contents(bag):
    """The messages of the bag by their topics, as the reader of the format's makers has them."""
    reader = pytest.importorskip("mcap.reader", reason="mcap is not installed")
    decoder = pytest.importorskip("mcap_ros2.decoder", reason="mcap-ros2-support is not installed")
    (file,) = bag.glob("*.mcap")
    found = {}
    with file.open("rb") as stream:
        made = reader.make_reader(stream, decoder_factories=[decoder.DecoderFactory()])
        for _, channel, message, content in made.iter_decoded_messages():
            found.setdefault(channel.topic, []).append((message.log_time, content))
    return found


def test_a_bag_of_times_since_1970_keeps_them(folder, tmp_path):
    times = 1.7e9 + np.arange(COUNT) / FPS
    shutil.copytree(folder, tmp_path / "r")
    (tmp_path / "r" / "timestamps.csv").write_text(
        table_text(pd.DataFrame({"frame": range(COUNT), "t_s": times}))
    )
    write_bag(tmp_path / "r", tmp_path / "bag")
    unpack_bag(tmp_path / "bag", tmp_path / "back")
    back, _ = open_folder(tmp_path / "back")
    assert np.allclose(back.times_s, times, rtol=0, atol=1e-6)


def vector(one):
    return np.array([one.x, one.y, one.z])


def turned(one):
    return Rotation.from_quat([one.x, one.y, one.z, one.w])


def test_another_reader_finds_all_topics_and_the_arm(contents):
    expected = {f"/{name}/image": COUNT for name in RIG.names}
    expected |= {f"/{name}/camera_info": 1 for name in RIG.names}
    expected |= {"/tf_static": 1, "/handle_description": 1}
    expected |= {"/handle_pose": COUNT - 1, "/tf": COUNT - 1}
    expected |= {"/joint_states": 2, "/joint_commands": 2}
    assert {topic: len(messages) for topic, messages in contents.items()} == expected
    _, state = contents["/joint_states"][1]
    _, command = contents["/joint_commands"][1]
    assert list(state.name) == ["elbow", "wrist"]
    assert list(state.position) == [0.21, 1.21]
    assert list(command.position) == [0.2, 1.2]
    assert list(command.velocity) == [0.6, 1.6]


def test_another_reader_finds_the_images_and_their_times(contents, folder):
    import cv2

    for name in RIG.names:
        files = sorted((folder / "images" / name).iterdir())
        for k, ((time_ns, content), image) in enumerate(
            zip(contents[f"/{name}/image"], read_greys(files), strict=True)
        ):
            found = cv2.imdecode(np.frombuffer(content.data, np.uint8), cv2.IMREAD_UNCHANGED)
            np.testing.assert_array_equal(found, image)
            assert content.format == "png"  # the one name that ROS and Foxglove both know
            stamp = content.header.stamp
            assert time_ns == stamp.sec * 10**9 + stamp.nanosec == round(k / FPS * 1e9)


def test_another_reader_projects_to_the_same_pixels(contents):
    """A point of the world, in metres, through tf_static and camera_info, by hand."""
    ((_, static),) = contents["/tf_static"]
    places = {one.child_frame_id: one.transform for one in static.transforms}
    point_mm = np.array([12.0, -7.0, 560.0])
    for camera in RIG.cameras:
        ((_, info),) = contents[f"/{camera.name}/camera_info"]
        place = places[info.header.frame_id]
        seen = turned(place.rotation).inv().apply(point_mm / 1000 - vector(place.translation))
        u, v, w = np.reshape(info.k, (3, 3)) @ seen
        np.testing.assert_allclose([u / w, v / w], camera.project(point_mm[None])[0], atol=1e-9)
        assert (info.width, info.height) == camera.size
        assert list(info.d) == list(camera.distortions)


def test_another_reader_finds_the_poses_in_metres(contents):
    for (_, content), (_, moved), T in zip(
        contents["/handle_pose"], contents["/tf"], POSES, strict=False
    ):
        (tf,) = moved.transforms
        pose = content.pose.pose
        # a pose file has nine digits
        np.testing.assert_allclose(vector(pose.position), T.translation / 1000, atol=1e-9)
        np.testing.assert_allclose(vector(tf.transform.translation), vector(pose.position))
        assert (turned(pose.orientation).inv() * T.rotation).magnitude() < 1e-7
        assert (content.header.frame_id, tf.child_frame_id) == ("world", "handle")
        spread = np.reshape(content.pose.covariance, (6, 6))
        np.testing.assert_allclose(np.diag(spread)[:3], 0.03e-6, rtol=1e-6)  # mm^2 in m^2
        np.testing.assert_allclose(np.diag(spread)[3:], 1e-4, rtol=1e-6)  # rad^2


def test_a_bag_becomes_the_recording_that_it_was(bag, folder, tmp_path):
    unpack_bag(bag, tmp_path / "again")
    before, handle = open_folder(folder)
    after, same = open_folder(tmp_path / "again")
    assert same == handle
    assert set(after.rig.names) == set(before.rig.names)
    np.testing.assert_allclose(after.times_s, before.times_s, atol=1e-9)  # ns
    for name in RIG.names:
        old, new = (r.rig.cameras[r.rig.names.index(name)] for r in (before, after))
        np.testing.assert_array_equal(new.matrix, old.matrix)
        # the rotation went through a quaternion, the length through metres
        np.testing.assert_allclose(
            new.T_cam_world.as_matrix(), old.T_cam_world.as_matrix(), atol=1e-9
        )
        for one, other in zip(
            read_greys(sorted((folder / "images" / name).iterdir())),
            read_greys(sorted((tmp_path / "again" / "images" / name).iterdir())),
            strict=True,
        ):
            np.testing.assert_array_equal(one, other)


def test_track_reads_a_bag(bag, folder, tmp_path):
    (file,) = bag.glob("*.mcap")
    # a bag does not say how well its cameras are known
    silent = tmp_path / "silent.toml"
    write_rig(replace(read_rig(folder / "rig.toml"), covariance=None), silent)
    unsaid = ["--rig", str(silent)]
    for source, more in ((folder, unsaid), (bag, []), (file, unsaid)):
        out = tmp_path / f"{source.name}.csv"
        assert main(["track", str(source), *more, "--out", str(out)]) == 0
    of_folder, of_bag, of_file = (
        pd.read_csv(tmp_path / f"{one.name}.csv") for one in (folder, bag, file)
    )
    pd.testing.assert_frame_equal(of_file, of_folder)
    # its rig went through metres and quaternions: 1e-13 mm, of which a fit makes no more than this
    pd.testing.assert_frame_equal(of_bag, of_folder, rtol=1e-5, atol=1e-5)
    assert (of_folder["status"] == "measured").all()
    silent.unlink()
    left = {path.suffix for path in tmp_path.iterdir()}
    assert left == {".csv", ".tum"}  # what was unpacked is gone


def stamped(ros, time_ns, frame):
    stamp = ros.types["builtin_interfaces/msg/Time"](time_ns // 10**9, time_ns % 10**9)
    return ros.types["std_msgs/msg/Header"](stamp, frame)


def text_of(ros, text):
    return ros.types["std_msgs/msg/String"](text)


def lens_of(ros, frame, model="plumb_bob", lens=(0.0,) * 5):
    none = ros.types["sensor_msgs/msg/RegionOfInterest"](0, 0, 0, 0, False)
    K = np.array([9.0, 0, 3, 0, 9, 2, 0, 0, 1])
    P = np.array([9.0, 0, 3, 0, 0, 9, 2, 0, 0, 0, 1, 0])
    header = stamped(ros, 0, frame)
    kind = ros.types["sensor_msgs/msg/CameraInfo"]
    return kind(header, 4, 6, model, np.array(lens), K, np.eye(3).ravel(), P, 0, 0, none)


def places_of(ros, worlds):
    """Each camera 1 m further along x, in the frame that is named."""
    types = ros.types
    turn = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, 0.0, 1.0)
    each = []
    for k, (camera, world) in enumerate(worlds.items()):
        moved = types["geometry_msgs/msg/Vector3"](float(k), 0.0, 0.0)
        whole = types["geometry_msgs/msg/Transform"](moved, turn)
        header = stamped(ros, 0, world)
        each.append(types["geometry_msgs/msg/TransformStamped"](header, camera, whole))
    return types["tf2_msgs/msg/TFMessage"](each)


def grey_of(ros, time_ns, encoding="mono8", size=(6, 4), padding=0, pixel=(70,), big=0):
    """An image of one grey level, whose rows end with other bytes; `pixel` are the bytes of a pixel, or
    of two.
    """
    width, height = size
    wide = width * ENCODINGS.get(encoding, (1, None))[0]
    data = np.full((height, wide + padding), 255, np.uint8)
    data[:, :wide] = np.resize(pixel, wide)
    header = stamped(ros, time_ns, "")
    kind = ros.types["sensor_msgs/msg/Image"]
    return kind(header, height, width, encoding, big, wide + padding, data.ravel())


@cache
def messages():
    from rosbags.typesys import Stores, get_typestore

    return get_typestore(Stores.ROS2_JAZZY)


def bag_of(path, contents, storage="MCAP"):
    """A bag of topics, each with a function that makes its messages."""
    from rosbags.rosbag2 import StoragePlugin, Writer

    ros = messages()
    kinds = {
        "camera_info": "sensor_msgs/msg/CameraInfo",
        "tf_static": "tf2_msgs/msg/TFMessage",
        "handle_description": "std_msgs/msg/String",
    }
    with Writer(path, version=9, storage_plugin=StoragePlugin[storage]) as writer:
        for topic, made in contents.items():
            kind = kinds.get(topic.rpartition("/")[2], "sensor_msgs/msg/Image")
            connection = writer.add_connection(topic, kind, typestore=ros)
            for content in made(ros):
                writer.write(connection, 5, ros.serialize_cdr(content, kind))
    return path


def bag_of_two(path, **other):
    """A bag with cameras a and b, two images each, and a handle; messages of topics in `other`'s
    place.
    """
    contents = {
        "/a/camera_info": info("a"),
        "/b/camera_info": info("b"),
        "/tf_static": lambda ros: [places_of(ros, {"a": "world", "b": "world"})],
        "/handle_description": lambda ros: [text_of(ros, handle_text(CODED))],
        "/a/image": greys([1], [2]),
        "/b/image": greys([1], [2]),
    }
    return bag_of(
        path, contents | {f"/{name.replace('__', '/')}": made for name, made in other.items()}
    )


def test_raw_images_of_others_are_read(tmp_path):
    """A bag of another writer: raw images, in colour, beside each other in time, and neither lenses nor
    a handle.
    """
    row = np.arange(0, 180, 10)

    left, right = (
        greys(*([t_s + late_s, "rgb8", (6, 4), 0, row] for t_s in (1.0, 1.1)))
        for late_s in (0, 1e-6)
    )
    topics = {"/rig/left/image_raw": left, "/rig/right/image_raw": right}
    bag = bag_of(tmp_path / "b", topics, "SQLITE3")
    cameras = [
        Camera.look_at(f"rig_{name}", (6, 4), 9.0, [x, 0, 0], [0, 0, 500])
        for name, x in (("left", 0), ("right", 100))
    ]
    write_handle(CODED, tmp_path / "handle.toml")
    unpack_bag(bag, tmp_path / "r", Rig(cameras), tmp_path / "handle.toml")
    recording, _ = open_folder(tmp_path / "r")
    np.testing.assert_allclose(recording.times_s, [1.0000005, 1.1000005], atol=1e-9)
    (first, _) = read_greys(sorted((tmp_path / "r" / "images" / "rig_left").iterdir()))
    grey = row.reshape(6, 3) @ [0.299, 0.587, 0.114]  # ITU-R BT.601
    np.testing.assert_allclose(first, np.tile(grey, (4, 1)), atol=0.51)  # rounded to whole levels


def test_the_bytes_at_the_end_of_a_row_belong_to_no_image(tmp_path):
    padded = greys(*([k, "mono8", (6, 4), 3] for k in (1, 2)))
    unpack_bag(bag_of_two(tmp_path / "b", a__image=padded), tmp_path / "r")
    for name in ("a", "b"):
        for image in read_greys(sorted((tmp_path / "r" / "images" / name).iterdir())):
            np.testing.assert_array_equal(image, np.full((4, 6), 70))
    recording, handle = open_folder(tmp_path / "r")
    np.testing.assert_allclose(recording.times_s, [1.0, 2.0], rtol=1e-12)
    places = [camera.T_world_cam.translation for camera in recording.rig.cameras]
    np.testing.assert_allclose(places, [[0, 0, 0], [1000, 0, 0]], atol=1e-9)
    assert handle == CODED


@pytest.mark.parametrize(
    ("encoding", "pixel", "big"),
    [
        ("8UC1", [70], 0),
        ("mono16", [0, 80], 0),
        ("mono16", [80, 0], 1),
        ("16UC1", [80, 0], 1),
        ("bgr8", [70, 70, 70], 0),
        ("8UC3", [70, 70, 70], 0),
        ("bgra8", [70, 70, 70, 255], 0),
        ("rgba8", [70, 70, 70, 0], 0),
        ("bayer_grbg8", [70], 0),
        ("yuv422", [128, 70], 0),
        ("yuv422_yuy2", [70, 128], 0),
    ],
)
def test_encodings_that_opencv_decodes_are_read(encoding, pixel, big, tmp_path):
    images = greys(*([k, encoding, (6, 4), 5, pixel, big] for k in (1, 2)))
    unpack_bag(bag_of_two(tmp_path / "b", b__image=images), tmp_path / "r")
    level = 80 * 256 / 257 if 80 in pixel else 70
    for image in read_greys(sorted((tmp_path / "r" / "images" / "b").iterdir())):
        np.testing.assert_allclose(image, level, atol=1e-4)


def test_an_image_that_is_missing_costs_its_instant(tmp_path, caplog):
    caplog.set_level("INFO")
    taken = {"a": [1, 2, 4, 5, 6, 8], "b": [1, 2, 3, 4, 5, 6, 7, 8]}
    made = {
        f"{name}__image": greys(*([k + 0.1, "mono8", (6, 4), 0, [10 * k]] for k in of))
        for name, of in taken.items()
    }
    unpack_bag(bag_of_two(tmp_path / "b", **made), tmp_path / "r")
    recording, _ = open_folder(tmp_path / "r")
    np.testing.assert_allclose(recording.times_s, np.array(taken["a"]) + 0.1)
    for name in "ab":
        images = read_greys(sorted((tmp_path / "r" / "images" / name).iterdir()))
        assert [image[0, 0] for image in images] == [10 * k for k in taken["a"]]
    assert "2 instants left out, of which a camera has no image (a 6, b 8)" in caplog.text


def test_places_are_joined_along_their_chains(tmp_path):
    def chained(ros):
        """Each a metre further along x than its parent; the robot is no camera's."""
        parents = {"a": "link", "b": "world", "tool": "robot", "link": "world", "world": "map"}
        one = places_of(ros, parents)
        for place in one.transforms:
            place.transform.translation.x = 1.0
        return [one]

    unpack_bag(bag_of_two(tmp_path / "b", tf_static=chained), tmp_path / "r")
    cameras = read_rig(tmp_path / "r" / "rig.toml").cameras
    places = [camera.T_world_cam.translation for camera in cameras]
    np.testing.assert_allclose(places, [[2000, 0, 0], [1000, 0, 0]], atol=1e-9)


def test_a_rational_lens_is_read(tmp_path):
    lens = [-0.3, 0.1, 0.0, 0.0, 0.0, 0.2, 0.05, 0.01]

    made = info("a", "rational_polynomial", lens=lens)
    unpack_bag(bag_of_two(tmp_path / "b", a__camera_info=made), tmp_path / "r")
    first, second = read_rig(tmp_path / "r" / "rig.toml").cameras
    assert first.distortions.tolist() == lens
    assert not second.distortions.any()


def info(*given, **options):
    return lambda ros: [lens_of(ros, *given, **options)]


def greys(*images):
    """Images from their times, s, and what else there is to say of them."""
    return lambda ros: [grey_of(ros, round(t_s * 1e9), *given) for t_s, *given in images]


LENS = [-0.3, 0.1, *[0] * 6, 0.2, 0, 0, 0]  # thin prism


@pytest.mark.parametrize(
    ("topic", "made", "says"),
    [
        ("a__camera_info", lambda ros: [], "/a/camera_info: no message in it"),
        ("b__camera_info", info("tripod"), "/tf_static does not say where 'tripod' stands"),
        ("a__camera_info", info("a", "equidistant"), "plumb_bob or .*, got 'equidistant'"),
        ("a__camera_info", info("a", lens=LENS), "/a/camera_info: distortions: expected k1, k2"),
        ("tf_static", lambda ros: [places_of(ros, {"a": "world", "b": "map"})], "got map, world"),
        ("a__second__image", greys([1]), "of camera a, got /a/image and /a/second/image"),
        ("handle_description", lambda ros: [], "no handle in it"),
        ("handle_description", lambda ros: [text_of(ros, "name = ")], "no valid TOML"),
        ("a__image", greys([1]), "expected as many images of each camera.*: a 1, b 2"),
        ("a__image", greys([1], [2.8]), "instant 1: the cameras' images are 0.8 s apart"),
        ("b__image", greys([1, "mono8", (4, 6)], [2]), "image 0: expected 6 x 4 .*got 4 x 6"),
        ("b__image", greys([1], [1, "32FC1"]), "/b/image: image 1: expected .*got '32FC1'"),
    ],
)
def test_what_makes_no_recording_is_said(tmp_path, topic, made, says):
    bad = bag_of_two(tmp_path / "b", **{topic: made})
    with pytest.raises(ValueError, match=f"^{re.escape(str(bad))}: .*{says}"):
        unpack_bag(bad, tmp_path / "r")
    assert [path.name for path in tmp_path.iterdir()] == ["b"]  # nothing is left of what was begun


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("bag r --out there", "exists already"),
        ("bag . --out b", "rig.toml"),
        ("bag r --poses timeless.csv --out b", "column 't_s' is empty"),
        ("bag r --joints early.csv --out b", "expected times from 0"),
        ("bag r --joints half.csv --out b", "'elbow_rad' is missing"),
        (
            "bag r --joints none.csv --out b",
            "expected columns like shoulder_measured_rad, got none",
        ),
        ("bag r --joints words.csv --out b", "expected numbers in all columns"),
        ("bag r --joints nan.csv --out b", "expected finite numbers in all columns"),
        ("track bad.mcap --out p.csv", "bad.mcap"),
        ("track none.mcap --out p.csv", "none.mcap"),
    ],
)
def test_what_cannot_be_written_or_read_is_said_in_one_line(
    folder, tmp_path, monkeypatch, capsys, line, said
):
    monkeypatch.chdir(tmp_path)
    Path("r").symlink_to(folder)
    Path("there", "mine").mkdir(parents=True)
    Path("bad.mcap").write_bytes(b"no bag")
    poses = pd.read_csv(folder.parent / "poses.csv", dtype=str)
    for name, table in {
        "timeless": poses.assign(t_s=""),
        "early": JOINTS.assign(t_s=[-1.0, 0.0]),
        "half": JOINTS[["t_s", "elbow_measured_rad"]],
        "none": JOINTS[["t_s"]],
        "words": JOINTS.assign(wrist_rad=["0.1", "bent"]),
        "nan": JOINTS.assign(wrist_rad=[0.1, np.nan]),
    }.items():
        table.to_csv(f"{name}.csv", index=False)
    before = sorted(Path().iterdir())
    assert run(line) == 2
    (refusal,) = capsys.readouterr().err.splitlines()
    assert said in refusal
    assert sorted(Path().iterdir()) == before


def test_without_the_extra_a_line_names_it(folder, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with pytest.raises(ValueError, match=r"pip install 'trinolab\[ros\]'"):
        write_bag(folder, tmp_path / "bag")
