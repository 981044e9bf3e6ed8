"""A recording as a ROS 2 bag, read back by another reader (mcap), and tracked from it."""

import shutil
import signal
from dataclasses import replace
from functools import cache

import numpy as np
import pandas as pd
import pytest
from processes import started, wait_until
from scipy.spatial.transform import RigidTransform, Rotation

from satellites.bags.bags import ENCODINGS, is_bag, unpack_bag, write_bag
from trinolab.bench.optics import Bench
from trinolab.bench.scene import render_rig
from trinolab.datasets import load_handle, paper_rig
from trinolab.files import recording_writer
from trinolab.files.images import read_greys
from trinolab.files.outputs import table_text
from trinolab.files.poses import pose_table, write_poses
from trinolab.files.recording import open_folder
from trinolab.files.rigs import handle_text, read_rig, write_rig
from trinolab.following import posetracker
from trinolab.pose import LOST, Pose
from workbench.cli import main

rosbags = pytest.importorskip("rosbags.rosbag2", reason="extra ros is not installed")

# A bag that is begun, and never ready.
ENDLESS = """
import sys, time
from satellites.bags import bags
from workbench.cli import main

def write(messages, place, ros):
    place.mkdir(parents=True)
    time.sleep(900)

bags._write = write
sys.exit(main(sys.argv[1:]))
"""
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
    arguments = ["--poses", str(folder.parent / "poses.csv")]
    arguments += ["--joints", str(folder.parent / "joints.csv")]
    assert main(["bag", str(folder), *arguments, "--out", str(out)]) == 0
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


def test_another_reader_finds_all_topics(contents):
    expected = {f"/{name}/image": COUNT for name in RIG.names}
    expected |= {f"/{name}/camera_info": 1 for name in RIG.names}
    expected |= {"/tf_static": 1, "/handle_description": 1}
    expected |= {"/handle_pose": COUNT - 1, "/tf": COUNT - 1}
    expected |= {"/joint_states": 2, "/joint_commands": 2}
    assert {topic: len(messages) for topic, messages in contents.items()} == expected


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


def test_another_reader_finds_the_arm(contents):
    _, state = contents["/joint_states"][1]
    _, command = contents["/joint_commands"][1]
    assert list(state.name) == ["elbow", "wrist"]
    assert list(state.position) == [0.21, 1.21]
    assert list(command.position) == [0.2, 1.2]
    assert list(command.velocity) == [0.6, 1.6]


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


def test_an_interrupted_track_of_a_bag_leaves_nothing_and_begins_anew(bag, tmp_path, monkeypatch):
    out = tmp_path / "p.csv"
    real, calls = posetracker.step, []

    def step(*arguments):
        calls.append(1)
        if len(calls) == 3:
            raise KeyboardInterrupt
        return real(*arguments)

    monkeypatch.setattr(posetracker, "step", step)
    assert main(["track", str(bag), "--out", str(out)]) == 130
    assert not list(tmp_path.iterdir())
    assert main(["track", str(bag), "--out", str(out)]) == 0
    assert {path.name for path in tmp_path.iterdir()} == {"p.csv", "p.tum"}
    assert len(pd.read_csv(out)) == COUNT


def test_raw_images_of_others_are_read(bag, tmp_path):
    """A bag of another writer: raw images, in colour, beside each other in time, and no handle."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    ros = get_typestore(Stores.ROS2_HUMBLE)
    types = ros.types
    colour = np.arange(4 * 6 * 3, dtype=np.uint8).reshape(4, 6, 3)
    with Writer(tmp_path / "b", version=8, storage_plugin=StoragePlugin.SQLITE3) as writer:
        kind = "sensor_msgs/msg/Image"
        for name, off_ns in (("left", 0), ("right", 1000)):
            topic = writer.add_connection(f"/rig/{name}/image_raw", kind, typestore=ros)
            for k in range(2):
                time_ns = 10**9 + k * 10**8 + off_ns
                stamp = types["builtin_interfaces/msg/Time"](time_ns // 10**9, time_ns % 10**9)
                header = types["std_msgs/msg/Header"](stamp, name)
                image = types[kind](header, 4, 6, "rgb8", 0, 18, colour.ravel())
                writer.write(topic, time_ns, ros.serialize_cdr(image, kind))
    cameras = (f"rig_{name}" for name in ("left", "right"))
    text = "".join(
        f'[{name}]\nname = "{name}"\nsize = [6, 4]\nmatrix = [[9.0, 0.0, 3.0], [0.0, 9.0, 2.0], '
        f"[0.0, 0.0, 1.0]]\nrotation = [0.0, 0.0, 0.0]\ntranslation = [{100.0 * k}, 0.0, 0.0]\n"
        for k, name in enumerate(cameras)
    )
    (tmp_path / "rig.toml").write_text(text)
    recording_writer.write_handle(CODED, tmp_path / "handle.toml")
    unpack_bag(
        tmp_path / "b", tmp_path / "r", read_rig(tmp_path / "rig.toml"), tmp_path / "handle.toml"
    )
    recording, _ = open_folder(tmp_path / "r")
    np.testing.assert_allclose(recording.times_s, [1.0000005, 1.1000005], atol=1e-9)
    (first, _) = read_greys(sorted((tmp_path / "r" / "images" / "rig_left").iterdir()))
    grey = colour @ [0.299, 0.587, 0.114]  # ITU-R BT.601
    np.testing.assert_allclose(first, grey, atol=0.51)  # rounded to whole levels


def test_what_cannot_be_written_or_read_is_said_in_one_line(bag, folder, tmp_path, capsys):
    (tmp_path / "bad.mcap").write_bytes(b"no bag")
    (tmp_path / "joints.csv").write_text("t_s,elbow_measured_rad\n0,1\n")
    (tmp_path / "early.csv").write_text(JOINTS.assign(t_s=[-1.0, 0.0]).to_csv(index=False))
    wrong = [
        (["bag", str(folder), "--out", str(bag)], "exists already"),
        (["bag", str(tmp_path), "--out", str(tmp_path / "b")], "rig.toml"),
        (
            ["bag", str(folder), "--joints", str(tmp_path / "joints.csv"), "--out"]
            + [str(tmp_path / "b")],
            "'elbow_rad' is missing",
        ),
        (
            ["bag", str(folder), "--joints", str(tmp_path / "early.csv"), "--out"]
            + [str(tmp_path / "b")],
            "expected times from 0",
        ),
        (["track", str(tmp_path / "bad.mcap"), "--out", str(tmp_path / "p.csv")], "bad.mcap"),
        (["track", str(tmp_path / "none.mcap"), "--out", str(tmp_path / "p.csv")], "none.mcap"),
    ]
    before = sorted(tmp_path.iterdir())
    for arguments, what in wrong:
        assert main(arguments) == 2, arguments
        said = capsys.readouterr().err.strip()
        assert what in said, said
        assert "\n" not in said
    assert sorted(tmp_path.iterdir()) == before


def stamped(ros, time_ns, frame):
    stamp = ros.types["builtin_interfaces/msg/Time"](time_ns // 10**9, time_ns % 10**9)
    return ros.types["std_msgs/msg/Header"](stamp, frame)


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


def bag_of_two(path, **other):
    """A bag with cameras a and b, two images each, and a handle; messages of topics in `other`'s
    place.
    """
    from rosbags.rosbag2 import StoragePlugin, Writer

    ros = messages()
    text = ros.types["std_msgs/msg/String"]
    contents = {
        "/a/camera_info": lambda ros: [lens_of(ros, "a")],
        "/b/camera_info": lambda ros: [lens_of(ros, "b")],
        "/tf_static": lambda ros: [places_of(ros, {"a": "world", "b": "world"})],
        "/handle_description": lambda ros: [text(handle_text(CODED))],
        "/a/image": lambda ros: [grey_of(ros, 10**9), grey_of(ros, 2 * 10**9)],
        "/b/image": lambda ros: [grey_of(ros, 10**9), grey_of(ros, 2 * 10**9)],
    } | {f"/{name.replace('__', '/')}": made for name, made in other.items()}
    kinds = {
        "camera_info": "sensor_msgs/msg/CameraInfo",
        "tf_static": "tf2_msgs/msg/TFMessage",
        "handle_description": "std_msgs/msg/String",
    }
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        for topic, made in contents.items():
            kind = kinds.get(topic.rpartition("/")[2], "sensor_msgs/msg/Image")
            connection = writer.add_connection(topic, kind, typestore=ros)
            for content in made(ros):
                writer.write(connection, 5, ros.serialize_cdr(content, kind))
    return path


def test_the_bytes_at_the_end_of_a_row_belong_to_no_image(tmp_path):
    padded = bag_of_two(
        tmp_path / "b",
        a__image=lambda ros: [grey_of(ros, k * 10**9, padding=3) for k in (1, 2)],
    )
    unpack_bag(padded, tmp_path / "r")
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
        ("mono16", [70, 70], 0),
        ("mono16", [0, 80], 0),
        ("mono16", [80, 0], 1),
        ("16UC1", [80, 0], 1),
        ("bgr8", [70, 70, 70], 0),
        ("8UC3", [70, 70, 70], 0),
        ("rgb8", [70, 70, 70], 0),
        ("bgra8", [70, 70, 70, 255], 0),
        ("rgba8", [70, 70, 70, 0], 0),
        ("bayer_rggb8", [70], 0),
        ("bayer_grbg8", [70], 0),
        ("yuv422", [128, 70], 0),
        ("yuv422_yuy2", [70, 128], 0),
    ],
)
def test_encodings_that_opencv_decodes_are_read(encoding, pixel, big, tmp_path):
    images = [
        (10**9, encoding, (6, 4), 5, pixel, big),
        (2 * 10**9, encoding, (6, 4), 5, pixel, big),
    ]
    bag = bag_of_two(tmp_path / "b", b__image=lambda ros: [grey_of(ros, *of) for of in images])
    unpack_bag(bag, tmp_path / "r")
    level = 80 * 256 / 257 if 80 in pixel else 70
    for image in read_greys(sorted((tmp_path / "r" / "images" / "b").iterdir())):
        np.testing.assert_allclose(image, level, atol=1e-4)


def test_an_image_that_is_missing_costs_its_instant(tmp_path, caplog):
    caplog.set_level("INFO")
    taken = {"a": [1, 2, 4, 5, 6, 8], "b": [1, 2, 3, 4, 5, 6, 7, 8]}
    made = {
        f"{name}__image": lambda ros, of=of: [
            grey_of(ros, k * 10**9 + 10**8, pixel=[10 * k]) for k in of
        ]
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

    def made(ros):
        return [lens_of(ros, "a", "rational_polynomial", lens=lens)]

    unpack_bag(bag_of_two(tmp_path / "b", a__camera_info=made), tmp_path / "r")
    first, second = read_rig(tmp_path / "r" / "rig.toml").cameras
    assert first.distortions.tolist() == lens
    assert not second.distortions.any()


def nothing(ros):
    return []


@pytest.mark.parametrize(
    ("topic", "made", "says"),
    [
        ("a__camera_info", nothing, "/a/camera_info: no message in it"),
        (
            "b__camera_info",
            lambda ros: [lens_of(ros, "tripod")],
            "/b/camera_info: /tf_static does not say where 'tripod' stands; give a rig file",
        ),
        (
            "a__camera_info",
            lambda ros: [lens_of(ros, "a", "equidistant")],
            "/a/camera_info: expected the lens model plumb_bob or rational_polynomial, got 'equidistant'",
        ),
        (
            "a__camera_info",
            lambda ros: [lens_of(ros, "a", lens=[-0.3, 0.1, *[0] * 6, 0.2, 0, 0, 0])],
            "/a/camera_info: distortions: expected k1, k2, p1, p2, k3, k4, k5, k6, got others that are not "
            "zero",
        ),
        (
            "tf_static",
            lambda ros: [places_of(ros, {"a": "world", "b": "map"})],
            "/tf_static: expected all cameras in one frame, got map, world; give a rig file",
        ),
        (
            "a__second__image",
            lambda ros: [grey_of(ros, 1)],
            "expected one topic of images of camera a, got /a/image and /a/second/image",
        ),
        ("handle_description", nothing, "no handle in it (/handle_description)"),
        (
            "handle_description",
            lambda ros: [ros.types["std_msgs/msg/String"]("name = ")],
            "/handle_description: no valid TOML",
        ),
        (
            "a__image",
            lambda ros: [grey_of(ros, 10**9)],
            "expected as many images of each camera, and one at least: a 1, b 2",
        ),
        (
            "a__image",
            lambda ros: [grey_of(ros, 10**9), grey_of(ros, 2 * 10**9 + 8 * 10**8)],
            "instant 1: the cameras' images are 0.8 s apart, more than half a frame",
        ),
        (
            "b__image",
            lambda ros: [grey_of(ros, 10**9, size=(4, 6))] * 2,
            "/b/image: image 0: expected 6 x 4 pixels of grey or colour, got 4 x 6 of 'mono8'",
        ),
        (
            "b__image",
            lambda ros: [grey_of(ros, 10**9), grey_of(ros, 10**9, "32FC1")],
            "/b/image: image 1: expected 6 x 4 pixels of grey or colour, got '32FC1'",
        ),
    ],
)
def test_what_makes_no_recording_is_said_with_its_topic(tmp_path, topic, made, says):
    bad = bag_of_two(tmp_path / "b", **{topic: made})
    said = refusal(bad, tmp_path / "r")
    assert said.startswith(f"{bad}: {says}")
    assert [path.name for path in tmp_path.iterdir()] == ["b"]  # nothing is left of what was begun


def test_poses_without_times_and_joints_without_numbers_are_refused(folder, tmp_path):
    table = pd.read_csv(folder.parent / "poses.csv", dtype=str)
    table["t_s"] = ""
    table.to_csv(tmp_path / "poses.csv", index=False)
    with pytest.raises(ValueError, match=r"poses\.csv: column 't_s' is empty"):
        write_bag(folder, tmp_path / "bag", poses=tmp_path / "poses.csv")
    wrong = {
        "expected columns like shoulder_measured_rad, got none": JOINTS[["t_s"]],
        "expected numbers in all columns": JOINTS.assign(wrist_rad=["0.1", "bent"]),
        "expected finite numbers in all columns": JOINTS.assign(wrist_rad=[0.1, np.nan]),
    }
    for says, joints in wrong.items():
        joints.to_csv(tmp_path / "joints.csv", index=False)
        with pytest.raises(ValueError, match=rf"joints\.csv: {says}"):
            write_bag(folder, tmp_path / "bag", joints=tmp_path / "joints.csv")
    assert not (tmp_path / "bag").exists()


def refusal(bag, folder):
    """Why a bag cannot be unpacked; empty if it could."""
    try:
        unpack_bag(bag, folder)
    except ValueError as error:
        return str(error)
    return ""


def test_a_damaged_bag_is_one_line(tmp_path):
    """Cut off, or some bytes changed: a ValueError that names it, or all is there."""
    rng = np.random.default_rng(0)
    partial = recording_writer.begin(tmp_path / "r", RIG, CODED)
    width, height = RIG.cameras[0].size
    recording_writer.add(partial, RIG, 0, [np.zeros((height, width), np.uint8)] * len(RIG.names))
    recording_writer.finish(tmp_path / "r", [0.0])
    write_bag(tmp_path / "r", tmp_path / "b")
    whole = next((tmp_path / "b").glob("*.mcap")).read_bytes()
    for k in range(30):
        data = bytearray(whole)
        if k % 3 == 0:
            data = data[: rng.integers(1, len(data))]
        else:
            data[rng.integers(len(data))] = rng.integers(256)
            data[rng.integers(len(data))] = rng.integers(256)
        (tmp_path / "x.mcap").write_bytes(data)
        said = refusal(tmp_path / "x.mcap", tmp_path / f"o{k}")
        assert (tmp_path / f"o{k}" / "timestamps.csv").exists() == (not said)
        if said:
            assert "x.mcap" in said
            assert "\n" not in said
            assert not (tmp_path / f"o{k}").exists()
    assert not list(tmp_path.glob("*.partial"))


def test_a_bag_is_told_from_a_folder(bag, folder, tmp_path):
    assert is_bag(bag)
    assert is_bag(next(bag.glob("*.mcap")))
    assert not is_bag(folder)
    assert not is_bag(tmp_path / "missing.mcap")


def test_without_the_extra_a_line_names_it(folder, tmp_path, monkeypatch):
    import sys

    monkeypatch.setitem(sys.modules, "rosbags.typesys", None)
    with pytest.raises(ValueError, match=r"pip install 'trinolab\[ros\]'"):
        write_bag(folder, tmp_path / "bag")


def test_asked_to_end_it_leaves_nothing(folder, tmp_path):
    with started(f"bag {folder} --out {tmp_path / 'b'}", ENDLESS) as process:
        wait_until(lambda: (tmp_path / ".b.partial" / "b").is_dir(), process)
        process.send_signal(signal.SIGTERM)
    assert process.returncode == 128 + signal.SIGTERM
    assert list(tmp_path.iterdir()) == []
