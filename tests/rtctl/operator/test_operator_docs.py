"""What the pages say about the operator's message is what the code believes, and the example of a bridge works."""

import importlib.util
import re

import pytest

from hal.kernel import ROOT
from rtctl.operator.link import Loss
from rtctl.operator.message import Button, OperatorMessage, decode
from rtctl.operator.publisher import publish

PAGE = (ROOT / "docs" / "reference" / "formats" / "operator-message.md").read_text()


def test_the_page_has_every_field_every_button_and_a_message_that_is_one():
    example = re.search(r"```json\n(.*?)```", PAGE, re.DOTALL)[1]
    message = decode(example.encode())
    assert message.twist == (0.5, 0, 0, 0, 0, -0.02)
    for field in OperatorMessage.__struct_fields__:
        assert f"| `{field}` |" in PAGE
    for button in Button:
        assert f"| {button.bit_length() - 1} | {int(button)} | `{button.name}` |" in PAGE


def test_the_page_has_every_loss():
    told = re.findall(r"^\| [^|]* \| ([^|]*) \|$", PAGE.split("## When the deadman counts")[1], re.MULTILINE)
    assert {loss.value.split(":")[0] for loss in Loss} == {text for text in told if text not in ("what is told", "---")}


@pytest.fixture
def example():
    spec = importlib.util.spec_from_file_location("haptic_bridge", ROOT / "docs" / "examples" / "haptic_bridge.py")
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


class FakeSdk:
    """A vendor's library: renews its reading until it freezes, and raises once the device is unplugged."""

    def __init__(self, readings, frozen=0):
        self.readings, self.frozen, self.count = readings, frozen, 0

    def read(self):
        if self.count < self.readings:
            self.count += 1
        elif self.frozen:
            self.frozen -= 1
        else:
            raise OSError("unplugged")
        return self.count, (10.0, 0.0, 0.0), (0.0, 0.0, 1.0), True


def test_a_handle_counts_while_its_readings_are_renewed(example):
    handle = example.HapticHandle(FakeSdk(10, frozen=10**6))
    for k in range(10):
        sample = handle.sample(1.0 + 0.01 * k)
        assert sample.deadman
        assert sample.twist == (1.0, 0, 0, 0, 0, 0.1)
    assert handle.sample(1.09 + 0.049).deadman
    assert not handle.sample(1.09 + 0.051).deadman, "frozen, whatever the clutch says"


def test_an_unplugged_device_ends_the_bridge(example):
    sent = []
    with pytest.raises(OSError, match="unplugged"):
        publish(example.HapticHandle(FakeSdk(30)), sent.append)
    assert sent
    assert all(sample.deadman for sample in sent)
