"""Where a socket of a node tree gets its value from, through reroutes and groups."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Socket:
    """An input socket, and the groups that it lies in.

    Attributes:
        socket: Blender's input socket.
        groups: the nodes of the groups around it, outermost first.
    """

    socket: Any
    groups: tuple[Any, ...] = ()

    @property
    def source(self) -> Output | None:
        """The output that feeds it, past reroutes, muted nodes and borders of groups; None where nothing does."""
        return self._followed()[0]

    @property
    def default(self) -> Any:
        """Its value where nothing feeds it; where it leads out of a group, that of the group's node."""
        end = self._followed()[1]
        value: Any = getattr(end, "default_value", None)
        return tuple(value) if hasattr(value, "__len__") and not isinstance(value, str) else value

    def _followed(self) -> tuple[Output | None, Any]:
        socket, groups = self.socket, self.groups
        while socket is not None and socket.is_linked and socket.links:
            link = socket.links[0]
            node, output = link.from_node, link.from_socket
            if node.bl_idname == "NodeReroute":
                socket = node.inputs[0]
            elif node.mute:
                passed = next((each.from_socket for each in node.internal_links if each.to_socket == output), None)
                if passed is None:
                    return None, output
                socket = passed
            elif node.bl_idname == "ShaderNodeGroup" and node.node_tree is not None:
                inner = _group_output(node.node_tree)
                end = None if inner is None else _named(inner.inputs, output.identifier)
                if end is None:
                    return None, output
                socket, groups = end, (*groups, node)
            elif node.bl_idname == "NodeGroupInput" and groups:
                socket, groups = _named(groups[-1].inputs, output.identifier), groups[:-1]
            else:
                return Output(node, output, groups), socket
        return None, socket


@dataclass(frozen=True)
class Output:
    """An output socket of a node.

    Attributes:
        groups: the nodes of the groups around it, outermost first.
    """

    node: Any
    socket: Any
    groups: tuple[Any, ...] = ()

    @property
    def kind(self) -> str:
        """Blender's name of the node's class, such as "ShaderNodeBsdfPrincipled"."""
        return str(self.node.bl_idname)

    @property
    def label(self) -> str:
        """What people call the node."""
        return str(self.node.bl_label)

    def input(self, name: str | int) -> Socket:
        """An input of the node, by its name or number."""
        return Socket(self.node.inputs[name], self.groups)

    def has(self, name: str) -> bool:
        """Whether the node has such an input: older versions of Blender lack some."""
        return name in self.node.inputs

    def enabled(self) -> list[Socket]:
        """Its inputs that are in use: nodes with several types have one set of sockets for each."""
        return [Socket(each, self.groups) for each in self.node.inputs if each.enabled]


def surface_output(tree: Any, kind: str = "ShaderNodeOutputMaterial") -> Output | None:
    """The active output node of a material or world, that for all engines or ours; None where there is none."""
    ends = [node for node in tree.nodes if node.bl_idname == kind]
    usable = [node for node in ends if getattr(node, "target", "ALL") in ("ALL", "CYCLES")] or ends
    chosen = next((node for node in usable if node.is_active_output), usable[0] if usable else None)
    return None if chosen is None else Output(chosen, None)


def _group_output(tree: Any) -> Any:
    ends = [node for node in tree.nodes if node.bl_idname == "NodeGroupOutput"]
    return next((node for node in ends if node.is_active_output), ends[0] if ends else None)


def _named(sockets: Any, identifier: str) -> Any:
    return next((each for each in sockets if each.identifier == identifier), None)
