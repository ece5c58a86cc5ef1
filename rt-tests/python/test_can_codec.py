"""crates/can-codec against cantools: the robots' DBC files and random ones.

The crate's example `codec_json` decodes and encodes what it is asked to.
"""

import math
import random
from pathlib import Path

import cantools
import pytest
from processes import example, json_program

ROOT = Path(__file__).resolve().parents[2]
ROBOTS = ["test-joint", "leg", "hrp2-like", "lift-gripper", "humanoid"]
FRAMES = 20


@pytest.fixture(scope="module")
def codec():
    return json_program(example("codec_json"))


def random_dbc(seed):
    """Messages of all lengths whose signals have random places, orders, signs and scales."""
    rng = random.Random(seed)
    text = 'VERSION ""\n\nNS_ :\n\nBS_:\n\nBU_: A B\n\n'
    floats = []
    for number, length in enumerate([1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64]):
        identifier = 100 + number if rng.random() < 0.7 else 1 << 31 | rng.getrandbits(29)
        text += f"BO_ {identifier} M{number}: {length} A\n"
        big = rng.random() < 0.5
        at = 0  # bits in the order in which a big-endian signal covers them, or a little-endian one
        while at < 8 * length:
            size = rng.choice([1, 3, 8, 11, 16, 19, 24, 32, 33, 48])
            kind = rng.choice("+-")
            if rng.random() < 0.15:
                size, kind = rng.choice([(32, "f"), (64, "d")])
            if at + size > 8 * length:
                break
            start = 8 * (at // 8) + 7 - at % 8 if big else at
            scale = rng.choice([1, 0.5, 0.001, 3e-6, -2])
            offset = rng.choice([0, 0, 17, -0.25])
            name = f"s{at}"
            sign = "+" if kind == "+" else "-"
            text += f' SG_ {name} : {start}|{size}@{int(not big)}{sign} ({scale},{offset}) [0|0] "" B\n'
            if kind in "fd":
                floats.append(f"SIG_VALTYPE_ {identifier} {name} : {1 if kind == 'f' else 2};\n")
            at += size + rng.choice([0, 0, 1, 5])
        text += "\n"
    return text + "".join(floats)


def databases():
    for robot in ROBOTS:
        yield robot, (ROOT / "robot-models" / robot / "drives.dbc").read_text()
    for seed in range(10):
        yield f"random{seed}", random_dbc(seed)


def finite_data(message, rng):
    """Random bytes whose floats are numbers."""
    while True:
        data = rng.randbytes(message.length)
        if all(math.isfinite(v) for v in message.decode(data, decode_choices=False).values()):
            return data


def raw_id(message):
    return message.frame_id | (1 << 31 if message.is_extended_frame else 0)


@pytest.mark.parametrize("text", [pytest.param(t, id=n) for n, t in databases()])
def test_frames_decode_to_the_same_values(codec, text):
    database = cantools.database.load_string(text, "dbc")
    rng = random.Random(1)
    cases = []
    for message in database.messages:
        for _ in range(FRAMES):
            data = finite_data(message, rng)
            cases.append((message, data, message.decode(data, decode_choices=False)))
    asked = [{"id": raw_id(m), "data": list(d)} for m, d, _ in cases]
    answer = codec(dbc=text, decode=asked)
    assert len(answer["decoded"]) == len(cases)
    for (message, data, theirs), ours in zip(cases, answer["decoded"], strict=True):
        assert ours.keys() == theirs.keys()
        for name, value in theirs.items():
            assert ours[name] == pytest.approx(float(value), rel=1e-12, abs=1e-12), (message.name, name, data)


@pytest.mark.parametrize("text", [pytest.param(t, id=n) for n, t in databases()])
def test_values_make_the_same_frames(codec, text):
    database = cantools.database.load_string(text, "dbc")
    rng = random.Random(2)
    cases = []
    for message in database.messages:
        if not message.signals:
            continue
        for _ in range(FRAMES):
            values = message.decode(finite_data(message, rng), decode_choices=False)
            values = {name: float(value) for name, value in values.items()}
            theirs = message.encode(values, strict=False)
            cases.append((message, values, theirs))
    answer = codec(dbc=text, encode=[{"message": m.name, "values": v} for m, v, _ in cases])
    for (message, values, theirs), ours in zip(cases, answer["encoded"], strict=True):
        if any(s.is_float for s in message.signals):
            # A float's scaling rounds differently in each library: compare the physical values.
            back = message.decode(bytes(ours), decode_choices=False)
            for name, value in values.items():
                assert float(back[name]) == pytest.approx(value, rel=1e-6, abs=1e-9), (message.name, name)
        else:
            assert bytes(ours) == theirs, (message.name, values)


def test_unknown_ids_and_wrong_lengths_are_distinguished(codec):
    text = (ROOT / "robot-models/leg/drives.dbc").read_text()
    answer = codec(dbc=text, decode=[{"id": 999, "data": [0]}, {"id": 257, "data": [0] * 7}, {"id": 128, "data": []}])
    assert answer["decoded"] == ["UnknownId", "WrongLength", {}]


@pytest.mark.parametrize("fault", ["BO_ 257 SECOND: 8 A\n", ' SG_ over : 0|8@1+ (1,0) [0|0] "" B\n'])
def test_files_that_cantools_refuses_are_refused(codec, fault):
    text = (ROOT / "robot-models/leg/drives.dbc").read_text()
    head, tail = text.split("BO_ 258 ", 1)
    text = (head.rstrip("\n") + "\n" + fault if fault.startswith(" ") else head + fault) + "\nBO_ 258 " + tail
    if fault.startswith(" "):
        with pytest.raises(cantools.database.errors.Error):
            cantools.database.load_string(text, "dbc", strict=True)
    assert "allowed: " in codec(dbc=text)["refused"]
