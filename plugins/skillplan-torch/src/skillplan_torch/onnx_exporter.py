"""The exporter `onnx`: a policy as a graph that ONNX Runtime and other libraries execute."""

from __future__ import annotations

import json
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from skillplan.errors import OptionError
from skillplan.exporters.exporter import Exporter, Handover, TrainedPolicy
from skillplan.task import back_end

# Versions that runtimes since 2022 read.
_OPSET, _IR_VERSION = 17, 8


class OnnxExporter(Exporter):
    """A trained policy as an ONNX graph: observation and mask in, scores and action out."""

    name: ClassVar[str] = "onnx"
    suffix: ClassVar[str] = ".onnx"
    needs_plan: ClassVar[bool] = False
    needs_policies: ClassVar[bool] = True

    class Options(back_end.Options):
        """Options of the exporter."""

        run: int | None = Field(
            default=None,
            ge=0,
            le=1_000,
            description="run whose policy is exported; null for the one of least cost, under "
            "chance expected [-]",
        )

    options: Options

    def refuses(self, handover: Handover) -> str | None:
        """Return None: a policy also chooses under chance."""
        return None

    def notes(self, handover: Handover) -> tuple[str, ...]:
        """Return the run, and the inputs that its policy expects."""
        run, policy = self._choose(handover)
        notes = [
            f"policy of run {run} of {policy.solver}, kept at step {policy.step:,}; "
            f"observation {policy.observation}, mask {policy.mask}"
        ]
        if policy.problem:
            notes.append(f"this policy has no cost: {policy.problem}")
        elif policy.cost is None:
            notes.append("no policy of this run has completed the task, so this is its last one")
        elif handover.chance:
            least = self.options.run is None and len(handover.policies) > 1
            of = f", the least of {len(handover.policies)} runs" if least else ""
            notes.append(f"expected cost {handover.task.cost_text(policy.cost)}{of}")
        return tuple(notes)

    def files(self, handover: Handover) -> Mapping[str, str | bytes]:
        """Return the graph; the names of features and actions are in its metadata."""
        _, policy = self._choose(handover)
        return {"policy.onnx": _build_model(policy)}

    def _choose(self, handover: Handover) -> tuple[int, TrainedPolicy]:
        policies, run = handover.policies, self.options.run
        if run is not None and run not in policies:
            known = ", ".join(map(str, policies))
            raise OptionError(f"-O onnx.run={run}: runs with a policy are {known}.")

        def cost_of(number: int) -> float:
            cost = policies[number].cost
            return np.inf if cost is None else cost

        chosen = min(policies, key=cost_of) if run is None else run
        return chosen, policies[chosen]


def _build_model(policy: TrainedPolicy) -> bytes:
    """Return a graph of matrix products, rectifiers and the choice among allowed actions."""
    try:
        from onnx import TensorProto, checker, helper, numpy_helper
    except ImportError:
        raise OptionError(
            "--to onnx needs the package onnx: pip install 'skillplan-torch[onnx]'."
        ) from None
    nodes, weights, layer = [], [], "observation"
    last = len(policy.weights) - 1
    for depth, (weight, bias) in enumerate(zip(policy.weights, policy.biases, strict=True)):
        for kind, array in (("weight", weight), ("bias", bias)):
            weights.append(numpy_helper.from_array(np.ascontiguousarray(array), f"{kind}_{depth}"))
        product, total = f"product_{depth}", f"sum_{depth}" if depth < last else "scores"
        nodes.append(helper.make_node("MatMul", [layer, f"weight_{depth}"], [product]))
        nodes.append(helper.make_node("Add", [product, f"bias_{depth}"], [total]))
        layer = total
        if depth < last:
            layer = f"layer_{depth + 1}"
            nodes.append(helper.make_node("Relu", [total], [layer]))
    weights.append(numpy_helper.from_array(np.array(-np.inf, dtype=np.float32), "never"))
    # A mask that allows no action allows all: any action then ends the episode.
    nodes += [
        helper.make_node("Cast", ["mask"], ["ones"], to=TensorProto.INT32),
        helper.make_node("ReduceMax", ["ones"], ["most"], axes=[1], keepdims=1),
        helper.make_node("Cast", ["most"], ["some"], to=TensorProto.BOOL),
        helper.make_node("Not", ["some"], ["none"]),
        helper.make_node("Or", ["mask", "none"], ["allowed"]),
        helper.make_node("Where", ["allowed", "scores", "never"], ["choices"]),
        helper.make_node("ArgMax", ["choices"], ["action"], axis=1, keepdims=0),
    ]

    def value(name: str, kind: int, *shape: Any) -> Any:
        return helper.make_tensor_value_info(name, kind, ["batch", *shape])

    graph = helper.make_graph(
        nodes,
        "policy",
        [
            value("observation", TensorProto.FLOAT, len(policy.features)),
            value("mask", TensorProto.BOOL, len(policy.actions)),
        ],
        [
            value("scores", TensorProto.FLOAT, len(policy.actions)),
            value("action", TensorProto.INT64),
        ],
        weights,
    )
    model = helper.make_model(
        graph,
        producer_name="skillplan",
        opset_imports=[helper.make_opsetid("", _OPSET)],
        ir_version=_IR_VERSION,
    )
    about = {
        "features": json.dumps(policy.features),
        "actions": json.dumps(policy.actions),
        "observation": policy.observation,
        "mask": policy.mask,
        "solver": policy.solver,
        "task": policy.task,
        "own_rule": policy.own_rule,
    }
    helper.set_model_props(model, about)
    checker.check_model(model)
    return bytes(model.SerializeToString(deterministic=True))
