"""From digitised points to a modal matrix: closed forms, arrays whose matrix is known, noise, and bad files."""

from pathlib import Path

import numpy as np
import pytest
from digitising import csv_of, images_of, markers, points_of
from hypothesis import given, settings
from hypothesis import strategies as st

from hal.errors import RtctlError
from rtctl.electrode.digitised import DigitisedError, Image, check_coverage, parse, read
from rtctl.electrode.image_calibration import calibrate_images
from rtctl.electrode.synthetic_arrays import STYLET_SAMPLES_MM, modal_matrix

EXAMPLE = Path(__file__).resolve().parents[3] / "docs" / "examples" / "array.csv"
S, Q = np.linspace(0, 18, 61), np.linspace(0, 15, 31)


def angles_of(modal):
    return np.vander(S, 4, increasing=True) @ modal @ np.vander(Q, 4, increasing=True).T


def image_of(points, stylet=0.0, name="1"):
    return Image(name, stylet, np.asarray(points, dtype=float), tuple(range(2, 2 + len(points))))


def exact_images(modal, s):
    return [
        image_of(
            points_of(lambda at, q=q: np.vander(at, 4, increasing=True) @ modal @ q ** np.arange(4.0), s), q, f"{q}"
        )
        for q in STYLET_SAMPLES_MM
    ]


@given(st.floats(-0.9, 0.9), st.floats(0.2, 1.2))
def test_arc_lengths_and_angles_of_a_circle_are_exact(curvature, spacing):
    s = spacing * np.arange(12.0)
    angle = 0.1 + curvature * s
    steps = np.sinc(curvature * spacing / 2 / np.pi) * spacing * np.exp(1j * (angle[:-1] + angle[1:]) / 2)  # chords
    z = np.append(0.0, np.cumsum(steps))
    image = image_of(np.stack((z.real, z.imag), axis=1))
    assert image.arc_mm == pytest.approx(s, abs=1e-9)
    assert image.chord_angle_rad == pytest.approx((angle[:-1] + angle[1:]) / 2, abs=1e-9)


@pytest.mark.parametrize("number", [1, 4, 7])
def test_arc_lengths_of_a_curled_array_are_those_of_its_markers(number):
    s = markers(np.random.default_rng(number))
    for image in exact_images(modal_matrix(number), s):
        chords = np.append(0.0, np.cumsum(np.linalg.norm(np.diff(image.points_mm, axis=0), axis=1)))
        assert np.abs(image.arc_mm - s).max() < 0.015
        assert np.abs(image.arc_mm - s).max() <= np.abs(chords - s).max() + 1e-3
    assert np.abs(chords - s).max() > 0.08  # which the chords of the last image would have missed


@settings(max_examples=10)
@given(st.integers(1, 7), st.integers(0, 100))
def test_an_array_of_the_model_comes_back_from_its_points(number, seed):
    modal = modal_matrix(number)
    found = calibrate_images(exact_images(modal, markers(np.random.default_rng(seed))))
    assert np.abs(angles_of(found.modal_matrix) - angles_of(modal)).max() < 0.01
    assert found.rms_rad < 2e-3


@pytest.mark.parametrize("number", range(1, 8))
def test_from_realistic_images_nearly_the_matrix_of_exact_angles(number):
    text = csv_of(images_of(number, seed=number))
    found = calibrate_images(parse(text))
    difference = angles_of(found.modal_matrix) - angles_of(modal_matrix(number))
    assert np.sqrt(np.mean(difference**2)) < 0.01
    assert 0.015 < found.rms_rad < 0.045  # a cubic cannot follow these arrays: 0.027 rad for the first


def test_residual_grows_as_the_clicks_scatter():
    rms = [calibrate_images(parse(csv_of(images_of(1, seed=2, click_sd_mm=sd)))).rms_rad for sd in (0.0, 0.01, 0.02)]
    # two points an angle: sqrt(2) sd / spacing, on top of what the model misses
    for sd, value in zip((0.01, 0.02), rms[1:], strict=True):
        assert value == pytest.approx(np.hypot(rms[0], np.sqrt(2) * sd / (18 / 23)), rel=0.1)


def test_images_may_be_digitised_at_different_places_and_repeated():
    first, second = (images_of(3, seed=seed) for seed in (1, 2))
    images = [(f"a{name}", q, points) for name, q, points in first] + [
        (f"b{name}", q, points[::2]) for name, q, points in second
    ]
    images = [
        (name, q, np.vstack((points, last[2][-1:])) if name[0] == "b" else points)
        for (name, q, points), last in zip(images, first + second, strict=True)
    ]
    found = calibrate_images(parse(csv_of(images)))
    difference = angles_of(found.modal_matrix) - angles_of(modal_matrix(3))
    assert np.sqrt(np.mean(difference**2)) < 0.015
    assert len(found.image_rms_rad) == 26


def test_residuals_are_those_of_the_images():
    found = calibrate_images(read(EXAMPLE))
    every = np.concatenate(found.residual_rad)
    assert found.rms_rad == pytest.approx(np.sqrt(np.mean(every**2)))
    assert found.image_rms_rad == pytest.approx([np.sqrt(np.mean(r**2)) for r in found.residual_rad])


def test_the_example_of_the_documentation_is_array_5():
    found = calibrate_images(read(EXAMPLE))
    assert len(found.images) == 13
    assert np.sqrt(np.mean((angles_of(found.modal_matrix) - angles_of(modal_matrix(5))) ** 2)) < 0.01


def test_columns_may_come_in_any_order_with_comments_blank_lines_and_a_mark_of_byte_order(tmp_path):
    (name, stylet, points), *_ = images_of(1)
    lines = ["\ufeff# from a spreadsheet", "", "y_mm, x_mm ,image,stylet_mm"]
    lines += [f'{y:.3f},{x:.3f},"{name}, left",{stylet}' for x, y in points] + ["", "# the end"]
    file = tmp_path / "points.csv"
    file.write_bytes("\r\n".join(lines).encode())
    (image,) = read(file)
    assert (image.name, image.stylet_mm) == ("01, left", 0.0)
    assert image.points_mm == pytest.approx(points, abs=5.1e-4)
    assert image.lines[0] == 4


HEADER = "image,stylet_mm,x_mm,y_mm\n"
STRAIGHT = [f"1,0,{x:.2f},0.00" for x in np.linspace(0, 18, 13)]


def changed(line, text):
    rows = STRAIGHT.copy()
    if text is None:
        del rows[line - 2]
    else:
        rows[line - 2] = text
    return HEADER + "\n".join(rows) + "\n"


def curl(sign, radius=2.8):
    angle = np.linspace(0, 18, 25) / radius
    return HEADER + "".join(f"1,15,{radius * np.sin(a):.3f},{sign * radius * (1 - np.cos(a)):.3f}\n" for a in angle)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "no point in the file"),
        (HEADER, "no point in the file"),
        ("image,stylet_mm,x_mm\n", "line 1: there is no column y_mm"),
        ("image,stylet_mm,x_px,y_px\n", "line 1: there is no column x_mm.*the first line must be image,stylet_mm,x_mm,y_mm"),
        ("image,stylet_mm,x_mm,y_mm,z\n", "line 1: a column is unknown or there twice: got 'z'"),
        ("image,stylet_mm,x_mm,y_mm,x_mm\n", "line 1: a column is unknown or there twice: got 'x_mm'"),
        ("image;stylet_mm;x_mm;y_mm\n", "line 1: there is no column"),
        (changed(5, "1,0,4.50"), r"line 5: wrong number of columns: got 3 \(allowed: 4\)"),
        (changed(5, "1,0,4,50,0,00"), "line 5: wrong number of columns"),
        (changed(5, "1,0,4.50,?"), "line 5: y_mm is not a number: got '\\?'"),
        (changed(5, "1,0,nan,0"), "line 5: x_mm is not finite"),
        (changed(5, ",0,4.5,0"), "line 5: the image has no name"),
        (changed(5, "1,1.27,4.5,0"), r"line 5: the withdrawal differs within image 1: got 1.27 \(allowed: 0 mm as before\)"),
        (changed(5, "2,0,4.5,0"), "line 6: image 1 was there before"),
        (changed(5, STRAIGHT[2]), "line 5: the point is that of the line before"),
        ("\n".join([HEADER.strip(), *STRAIGHT[:5]]), "line 2: image 1 has too few points: got 5"),
        ("\n".join([HEADER.strip(), *STRAIGHT[:-2]]), r"another length than the array: got 15.0 \(allowed: 17 .. 19 mm\)"),
        (HEADER + "\n".join(f"1,0,{x:.1f},0" for x in np.linspace(0, 720, 13)), "another length than the array: got 720.0"),
        (HEADER + "\n".join(f"1,15.24,{x:.1f},0" for x in np.linspace(0, 18, 13)), r"line 2: stylet_mm is out of bounds: got 15.24"),
        (HEADER + "\n".join([*STRAIGHT[:6], STRAIGHT[7], STRAIGHT[6], *STRAIGHT[8:]]), "line 8: the array turns too far at this point"),
        (HEADER + "\n".join(reversed(STRAIGHT)), "does not begin along .x"),
        (curl(-1.0), "curls to the wrong side"),
    ],
)  # fmt: skip
def test_a_bad_file_is_told_with_its_line(text, message):
    with pytest.raises(DigitisedError, match=message) as error:
        parse(text)
    assert error.value.exit_code == 2


def test_an_array_curled_to_the_right_side_is_taken():
    assert parse(curl(1.0))[0].chord_angle_rad[-1] > 6


@pytest.mark.parametrize(
    ("stylet", "message"),
    [
        ((2.0, 5.0, 10.0, 15.0), "smallest withdrawal is too far from the end.*got 2.0"),
        ((0.0, 5.0, 9.0, 12.0), "largest withdrawal is too far from the end.*got 12.0"),
    ],
)
def test_withdrawals_that_would_be_guessed_are_refused(stylet, message):
    with pytest.raises(DigitisedError, match=message):
        check_coverage([image_of([(0, 0), (1, 0)], q) for q in stylet])


def test_too_few_withdrawals_are_refused():
    images = [image for image in parse(csv_of(images_of(1))) if image.stylet_mm in (0.0, 7.62, 15.0)]
    with pytest.raises(RtctlError, match="too few different stylet withdrawals"):
        calibrate_images(images)


@pytest.mark.parametrize("data", [None, b"\xff\xfe\x00i"])
def test_a_file_that_cannot_be_read_is_told(tmp_path, data):
    file = tmp_path / "points.csv"
    if data is not None:
        file.write_bytes(data)
    with pytest.raises(DigitisedError, match=r"cannot be read|is not text"):
        read(file)
