"""Which equations have to be solved together: the fine Dulmage-Mendelsohn decomposition.

Source: A. L. Dulmage, N. S. Mendelsohn, Coverings of bipartite graphs, Canad. J. Math. 10, 1958.
"""

from __future__ import annotations

from typing import Any

from kinematics.model.topology import WORLD, Incidence, Structure
from kinematics.solve.steps import Orientation, PlanError, Turn


def tie_angles(structure: Structure) -> dict[str, Orientation]:
    """Angles that inputs and kept bodies tie together, as a tree from each root.

    Raises:
        PlanError: an angle is given twice.
    """
    import networkx as nx  # a quarter of a second, and plans are kept

    ties: dict[str, list[tuple[str, Turn]]] = {}
    graph = nx.Graph()
    graph.add_nodes_from([WORLD, *(body.name for body in structure.moving)])

    def tie(base: str, body: str, turn: Turn, name: str) -> None:
        if nx.has_path(graph, base, body):
            raise PlanError(
                f"{name} fixes the angle of '{body}' relative to '{base}', which others fix "
                "already; remove one of them"
            )
        graph.add_edge(base, body)
        ties.setdefault(base, []).append((body, turn))
        back = Turn(turn.input, turn.slider, -turn.sign, turn.relative_to)
        ties.setdefault(body, []).append((base, back))

    for index, slider in enumerate(structure.sliders):
        if slider.keeps is not None:
            on = structure.node(slider.on)
            tie(on, slider.keeps, Turn(slider=index), f"the slider of '{slider.joint}'")
    for index, part in enumerate(structure.inputs):
        if part.body is not None:
            base = structure.node(part.relative_to)
            fixed = part.relative_to if base == WORLD and part.relative_to != WORLD else None
            tie(base, part.body, Turn(index, relative_to=fixed), f"input '{part.name}'")
    orientations: dict[str, Orientation] = {}
    for root in graph:
        if root in orientations:
            continue
        orientations[root] = Orientation(root, ())
        pending = [root]
        while pending:
            base = pending.pop(0)
            for body, turn in ties.get(base, []):
                if body not in orientations:
                    turns = (*orientations[base].turns, turn)
                    orientations[body] = Orientation(root, turns)
                    pending.append(body)
    return orientations


def find_blocks(
    structure: Structure, orientations: dict[str, Orientation], dropped: set[Incidence]
) -> list[set[Any]]:
    """Variables and equations that belong together, in an order in which they can be solved.

    A joint's place on a body gives two equations: place of joint = place of body's first joint +
    the turned vector between them. A perfect matching of equations and variables orients them;
    the strongly connected components are the blocks.

    Args:
        structure: the linkage's.
        orientations: how the bodies' angles are tied together.
        dropped: incidences that hold already, because a loop through them is solved.

    Returns:
        Sets of ``("angle", body)``, ``("slide", slider)``, ``(axis, "body" | "joint", name)`` and
        ``("equation", number of the incidence, axis)``.

    Raises:
        PlanError: the inputs do not determine the pose, or determine it more than once.
    """
    import networkx as nx

    fixed = set(structure.fixed_joints)
    graph = nx.Graph()
    equations: list[tuple[str, int, str]] = []
    variables: dict[Any, None] = {}
    for index, incidence in enumerate(structure.incidences):
        if incidence in dropped or (incidence.body == WORLD and incidence.slider is None):
            continue
        used: list[Any] = []
        if incidence.body != WORLD:
            root = orientations[incidence.body].root
            first = structure.body(incidence.body).joints[0]
            turns = incidence.slider is not None or incidence.joint != first
            if turns and root != WORLD:
                used.append(("angle", root))
        if incidence.slider is not None and structure.driven_slider(incidence.slider) is None:
            used.append(("slide", incidence.slider))
        for axis in ("x", "y"):
            equation = ("equation", index, axis)
            equations.append(equation)
            graph.add_node(equation)
            own = list(used)
            if incidence.body != WORLD:
                own.append((axis, "body", incidence.body))
            if incidence.joint not in fixed:
                own.append((axis, "joint", incidence.joint))
            for variable in own:
                variables[variable] = None
                graph.add_edge(equation, variable)
    for body in structure.moving:  # an angle that no equation holds is a variable all the same
        if orientations[body.name].root == body.name:
            variables.setdefault(("angle", body.name))
            graph.add_node(("angle", body.name))
    matching = nx.bipartite.hopcroft_karp_matching(graph, equations)
    if any(variable not in matching for variable in variables):
        raise PlanError("the inputs leave something free to move")
    if any(equation not in matching for equation in equations):
        raise PlanError("more is prescribed than can move")
    order: dict[Any, int] = {variable: i for i, variable in enumerate(variables)}
    needs = nx.DiGraph()
    needs.add_nodes_from(order)
    for equation in equations:
        for variable in graph[equation]:
            if variable != matching[equation]:
                needs.add_edge(variable, matching[equation])
    condensed = nx.condensation(needs)
    first = {node: min(order[v] for v in data["members"]) for node, data in condensed.nodes.items()}
    return [
        members | {matching[variable] for variable in members}
        for node in nx.lexicographical_topological_sort(condensed, key=first.__getitem__)
        for members in [set(condensed.nodes[node]["members"])]
    ]
