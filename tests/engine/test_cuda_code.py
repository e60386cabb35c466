"""The compiled GPU kernel (PTX), interpreted instruction by instruction on the CPU.

The tests need the CUDA compiler (extra `gpu`) but no GPU: the PTX is translated to Python, whose floats are IEEE
doubles too. They cannot show that a GPU executes PTX as specified.
"""

from __future__ import annotations

import ctypes
import importlib.util
import math
import re
import struct
from collections.abc import Callable
from types import SimpleNamespace
from typing import Any

import numba
import numpy as np
import pytest

from photosite.engine.jit import read_only
from photosite.engine.pixel_model import DrawnConstants, DrawnMaps, Exposure, expose_drawn
from photosite.engine.random_numbers import key_from_seed

EXPOSURE = Exposure(0.7, 30000.0, 0.4, 200.0, 16383.0, 70, 333, 5000, np.uint32(9), *key_from_seed(2**40 + 17))


@pytest.fixture(scope="module")
def compile_ptx() -> Callable[[], str]:
    if importlib.util.find_spec("numba_cuda") is None or numba.config.ENABLE_CUDASIM:
        pytest.skip("the CUDA compiler (extra gpu) is not installed, or the simulator is active")
    from numba import cuda
    from numba.core import sigutils
    from numba.cuda import dispatcher

    from photosite.engine.cuda import SIGNATURE, expose_thread

    def ptx() -> str:
        arguments, _ = sigutils.normalize_signature(SIGNATURE)
        with pytest.MonkeyPatch.context() as patch:
            # Device functions are compiled for the GPU that is present; none needs to be.
            patch.setattr(dispatcher, "get_current_device", lambda: SimpleNamespace(compute_capability=(8, 0)))
            code, _ = cuda.compile_ptx(expose_thread, arguments, cc=(8, 0))
        return str(code)

    return ptx


def test_no_operation_is_fused(compile_ptx: Callable[[], str]) -> None:
    """With default options the compiler fuses, and the check detects it."""
    from photosite.engine.cuda import NoCudaError, check_unfused, unfused

    with pytest.raises(NoCudaError, match="rounds differently"):
        check_unfused(compile_ptx())
    with unfused():
        code = compile_ptx()
    check_unfused(code)
    assert code.count("mul.rn.f64") > 100


@pytest.mark.parametrize("constant", [False, True])
def test_interpreted_kernel_equals_the_cpu(compile_ptx: Callable[[], str], constant: bool) -> None:
    """10 000 pixels with means from 0 to beyond the well capacity, so that every branch is taken."""
    from photosite.engine.cuda import unfused

    rng = np.random.default_rng(4)
    levels = np.array([0, 1e-3, 0.5, 4.0, 9.99, 10.0, 11.0, 17.0, 40.0, 900.0, 29900.0, 60000.0])
    photo = rng.choice(levels, (40, 250)).astype(np.float32)
    photo[:20] = 10 ** rng.uniform(-3, 5, (20, 250))
    shape = (1, 1) if constant else photo.shape
    prnu, offset = (rng.integers(-9000, 9000, shape).astype(np.int16) for _ in range(2))
    lines = [rng.normal(0.0, 3.0, length) for length in shape]
    maps = DrawnMaps(prnu, offset, rng.random(shape).astype(np.float32), *lines)
    constants = DrawnConstants(1e-5, 2e-3, 12.5)
    out = np.zeros(photo.shape, np.uint16)
    with unfused():
        thread = translated(compile_ptx())
    flat = [word for argument in (photo, *maps, *constants, *EXPOSURE, out) for word in words(argument)]
    for row, col in np.ndindex(photo.shape):
        thread(flat, row, col)
    np.testing.assert_array_equal(
        out, expose_drawn(read_only(photo), DrawnMaps(*map(read_only, maps)), constants, EXPOSURE)
    )


def words(argument: Any) -> list[Any]:
    """An argument as numba passes it: an array is owner, parent, items, item size, address, shape, strides."""
    if isinstance(argument, np.ndarray):
        return [0, 0, argument.size, argument.itemsize, argument.ctypes.data, *argument.shape, *argument.strides]
    return [float(argument) if isinstance(argument, float) else int(argument)]


# From PTX to Python: integers are kept unsigned, of the width of their register; predicates are bools.
SIZE = {"s16": 16, "u16": 16, "s32": 32, "u32": 32, "b32": 32, "s64": 64, "u64": 64, "b64": 64}
COMPARE = {"lt": "<", "le": "<=", "gt": ">", "ge": ">=", "eq": "==", "ne": "!="}
COMPARE |= {f"{name}u": sign for name, sign in COMPARE.items()}  # "or one is not a number": none is
ARITHMETIC = {"add": "+", "sub": "-", "mul": "*", "and": "&", "or": "|", "xor": "^", "shl": "<<", "shr": ">>"}
LOAD = {"f32": ctypes.c_float, "f64": ctypes.c_double, "u16": ctypes.c_uint16}
SPECIAL = {"%tid.x": "col", "%tid.y": "row", "%ctaid.x": "0", "%ctaid.y": "0", "%ntid.x": "1", "%ntid.y": "1"}


def translated(ptx: str) -> Callable[[list[Any], int, int], None]:
    """A function of (kernel arguments, row, column) that does what a thread of the PTX's one kernel does."""
    constants = {
        name: ctypes.create_string_buffer(bytes(map(int, data.split(","))))
        for name, data in re.findall(r"\.const .*?\.b8 (\S+)\[\d+\] = \{(.*?)\};", ptx)
    }
    blocks: list[list[str]] = [[]]
    labels: dict[str, int] = {}
    body = ptx[ptx.index("{\n", ptx.index(".entry")) + 2 : ptx.rindex("}")]
    for line in filter(None, map(str.strip, body.splitlines())):
        if line.endswith(":"):
            labels[line[:-1]] = len(blocks)
            blocks.append([])
        elif not line.startswith((".", "//")):
            blocks[-1].append(line.rstrip(";"))
    source = ["def thread(arguments, row, col):", " at = 0", " while True:"]
    for number, block in enumerate(blocks):
        source += [f"  if at == {number}:", f"   at = {number + 1}", *(f"   {statement(s, labels)}" for s in block)]
    names: dict[str, Any] = {"math": math, "LOAD": LOAD, "signed": signed}
    names |= {f"at_{name}".replace("$", "_"): ctypes.addressof(buffer) for name, buffer in constants.items()}
    names["constants"] = constants  # keeps the buffers alive
    names["bits"] = lambda value: struct.unpack("<Q", struct.pack("<d", value))[0]
    names["double_of"] = lambda value: struct.unpack("<d", struct.pack("<Q", value))[0]
    exec("\n".join(source), names)
    thread: Callable[[list[Any], int, int], None] = names["thread"]
    return thread


def signed(value: int, size: int) -> int:
    return value - (1 << size) if value >> (size - 1) else value


def statement(line: str, labels: dict[str, int]) -> str:
    guard = re.match(r"@(!?)%(\w+)\s+(.*)", line)
    if guard:
        return f"if {'not ' if guard[1] else ''}{guard[2]}: {statement(guard[3], labels)}"
    operation, _, rest = re.sub(r"\s+", " ", line).partition(" ")
    name, *kinds = operation.split(".")
    if name == "ret":
        return "return"
    if name == "bra":
        return f"at = {labels[rest]}; continue"
    target, *operands = re.split(r", *", rest)
    if name == "st":
        return f"{address(target, kinds[-1])}.value = {value(operands[0])}"
    return f"{target[1:]} = {expression(name, kinds, target, operands)}"


def address(operand: str, kind: str) -> str:
    found = re.fullmatch(r"\[(%\w+)(?:\+(-?\d+))?\]", operand)
    assert found, operand
    return f"LOAD['{kind}'].from_address({found[1][1:]} + {found[2] or 0})"


def value(operand: str) -> str:
    if operand in SPECIAL:
        return SPECIAL[operand]
    if operand.startswith("%"):
        return operand[1:]
    if operand.startswith("0d"):
        return repr(struct.unpack(">d", bytes.fromhex(operand[2:]))[0])
    if re.fullmatch(r"-?\d+", operand):
        return f"({operand})"
    return f"at_{operand}".replace("$", "_")


def expression(name: str, kinds: list[str], target: str, operands: list[str]) -> str:
    kind = kinds[-1]
    if name == "ld" and kinds[0] == "param":
        found = re.search(r"_param_(\d+)\]", operands[0])
        assert found, operands
        return f"arguments[{found[1]}]"
    if name == "ld":
        return f"{address(operands[0], kind)}.value"
    a, b, c = ([value(operand) for operand in operands] + ["", ""])[:3]
    if name in ("mov", "cvta"):
        if kind == "b64" and target.startswith("%fd") != operands[0].startswith("%fd"):
            return f"double_of({a})" if target.startswith("%fd") else f"bits({a})"
        return f"{a} & {2 ** SIZE[kind] - 1}" if kind in SIZE else a
    if name == "selp":
        return f"{a} if {c} else {b}"
    if name == "cvt":
        return converted(kinds, a)
    return floating(name, kinds, a, b) if kind.startswith("f") else integer(name, kinds, a, b)


def converted(kinds: list[str], a: str) -> str:
    *how, to, of = kinds
    if of.startswith("s"):
        a = f"signed({a} & {2 ** SIZE[of] - 1}, {SIZE[of]})"
    elif of.startswith("u"):
        a = f"({a} & {2 ** SIZE[of] - 1})"
    if to.startswith("f"):
        assert how in ([], ["rn"], ["rmi"]), kinds
        return f"float(math.floor({a}))" if how == ["rmi"] else f"float({a})"
    assert how == (["rzi"] if of == "f64" else []), kinds
    return f"int({a}) & {2 ** SIZE[to] - 1}"


def floating(name: str, kinds: list[str], a: str, b: str) -> str:
    if name == "setp":
        return f"{a} {COMPARE[kinds[0]]} {b}"
    if name in ("neg", "abs", "min", "max", "copysign"):
        # PTX takes the sign from its first operand, Python from its second.
        return {"neg": f"-{a}", "abs": f"abs({a})", "copysign": f"math.copysign({b}, {a})"}.get(
            name, f"{name}({a}, {b})"
        )
    assert kinds == ["rn", "f64"], (name, kinds)
    others = {"sqrt": f"math.sqrt({a})", "rcp": f"1.0 / {a}", "div": f"{a} / {b}"}
    return others[name] if name in others else f"{a} {ARITHMETIC[name]} {b}"


def integer(name: str, kinds: list[str], a: str, b: str) -> str:
    *how, kind = kinds
    if kind == "pred":
        return f"{a} {ARITHMETIC[name]} {b}"
    size = SIZE[kind]
    if kind.startswith("s") and name in ("setp", "shr", "min", "max", "mul"):
        a, b = (f"signed({x} & {2**size - 1}, {size})" for x in (a, b))
    elif how == ["wide"] or name == "setp":
        a, b = (f"({x} & {2**size - 1})" for x in (a, b))
    if name == "setp":
        return f"{a} {COMPARE[how[0]]} {b}"
    if name in ("min", "max"):
        return f"{name}({a}, {b}) & {2**size - 1}"
    return f"({a} {ARITHMETIC[name]} {b}) & {2 ** (2 * size if how == ['wide'] else size) - 1}"
