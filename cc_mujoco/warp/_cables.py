"""Cables of all worlds of a mujoco_warp model: their arrays and their callback."""

from collections.abc import Callable, Mapping
from copy import copy
from importlib import import_module
from typing import Any

import mujoco
import mujoco_warp as mjw
import numpy as np
import warp as wp
from numpy.typing import ArrayLike, NDArray

from cc_mujoco._utils.arguments import numbers, require_kind
from cc_mujoco._validation import require_list
from cc_mujoco.cable import _kernel as kernel
from cc_mujoco.cable import _layout as at
from cc_mujoco.cable import _reading as reading
from cc_mujoco.cable._cable import ENDS, PATHS, TERMS, Cable
from cc_mujoco.cable._conduit import packed_parameters
from cc_mujoco.cable._friction import INDEX
from cc_mujoco.cable._newmark import NEWMARK
from cc_mujoco.cable._parameter import Parameter
from cc_mujoco.cable._route import Route
from cc_mujoco.errors import CableError, shown
from cc_mujoco.native import FloatArray
from cc_mujoco.warp import _kernels as of_cables
from cc_mujoco.warp import _model as models
from cc_mujoco.warp._build import paths_of
from cc_mujoco.warp._kernels import write_rows
from cc_mujoco.warp._paths import LedCables, Views


class AttachedCables:
    """Cables of all worlds, see `attach`.

    Attributes:
        names: names of the cables, in the order of the model.
        terms: parameters of `Cable` whose terms are in the kernels.
        tensions: `wp.array` (worlds, cables, 2), tension at the proximal and the distal
            end at the last evaluation [N].
        values: `wp.array` (cables, worlds, parameters), scalar parameters in the order
            of `cable/parameters.csv`; call `repack` after a change.
        is_evaluated: True once a step, or a captured graph, has evaluated them.
    """

    def __init__(
        self,
        m: mjw.Model,
        d: mjw.Data,
        model: mujoco.MjModel,
        cables: Mapping[str, models.HeldCable],
        routes: Mapping[str, Route],
        terms: tuple[str, ...],
        rest_in_pose: bool,
    ) -> None:
        """Allocate the arrays of the cables and set the callback; see `attach`."""
        if not cables:
            raise CableError(
                "source has no cable to attach to mujoco_warp; give the specification "
                "that you gave to `without_plugin`"
            )
        for name, held in cables.items():
            require_kind(f"cable {name!r}", held, models.HeldCable)
        plain = {name: held.cable for name, held in cables.items()}
        models.require_supported(int(m.opt.integrator))
        models.require_routes(plain, routes)
        self._model, self.names = model, tuple(cables)
        self._cables, self._worlds = tuple(plain.values()), int(d.nworld)
        self._routes = [routes.get(name) for name in cables]
        self.terms = _terms_in_use(self._cables, terms)
        actuators = models.actuators_of(model, cables)
        models.require_plain(m, model, actuators)
        self._actuators_of = actuators
        self._step: float | None = None
        # A step of this integrator holds ends by itself; older MuJoCo has none.
        discrete = getattr(mujoco.mjtIntegrator, "mjINT_DISCRETE", None)
        if int(m.opt.integrator) != discrete:
            self._step = float(m.opt.timestep.numpy().max())
        self._look = [
            self._stiffness(cable, index) > NEWMARK.implicit_limit
            for index, cable in enumerate(self._cables)
        ]
        self._implicit = any(self._look)
        segments = [cable.segments for cable in self._cables]
        self._paths = paths_of(segments, self._routes)
        self._kernels = of_cables.kernels(self.terms, self._implicit, self._paths)
        self._moments = Views(of_cables.Moments, of_data="moment_rownnz")
        self._shape, self._device = (len(cables), self._worlds), d.time.device
        self._allocate(d, bool(rest_in_pose))
        self.is_evaluated = False
        self._before: Callable[[Any, Any], None] | None = m.callback.act_bias
        m.callback.act_bias = self._act

    def _stiffness(self, cable: Cable, index: int) -> float:
        """Return the squared step times frequency of a cable's ends; 0 if explicit."""
        if cable.ends != ENDS[0] or self._step is None:
            return 0.0
        route, prm = self._routes[index], self._packed(index, cable)
        rates = (
            models.end_rate(self._model, prm, cable.segments, actuator, end)
            for end, actuator in enumerate(self._actuators_of[index])
            if route is None or not route.tied[end]
        )
        return max(rates, default=0.0) * self._step**2

    def _packed(self, index: int, cable: Cable) -> FloatArray:
        route = self._routes[index]
        return packed_parameters(cable) if route is None else route.packed(cable)

    def _allocate(self, d: mjw.Data, rest_in_pose: bool) -> None:
        (count, worlds), device = self._shape, self._device
        most = max(cable.segments for cable in self._cables)
        actuators, height = self._actuators_of, count * worlds
        interleaved = _is_interleaved(device)

        def matrix(width: int, *planes: int, height: int = height) -> Any:
            if not interleaved:
                return wp.zeros((*planes, height, width), dtype=float, device=device)
            whole = wp.zeros((*planes, width, height), dtype=float, device=device)
            order = (0, 2, 1) if planes else (1, 0)
            return whole.transpose(order)

        packed = np.zeros((count, kernel.parameter_size(most)), np.float32)
        values = np.zeros((count, worlds, at.SCALARS), np.float32)
        for i, cable in enumerate(self._cables):
            own = self._packed(i, cable)
            packed[i, : own.size] = own
            values[i] = own[: at.SCALARS]
        trn_tendon = int(mujoco.mjtTrn.mjTRN_TENDON)
        held = self._model.actuator_trntype[actuators] == trn_tendon
        tied = np.array([r.tied if r else (False, False) for r in self._routes])
        data = mujoco.MjData(self._model)
        mujoco.mj_fwdPosition(self._model, data)
        rest = np.where(tied, 0.0, data.actuator_length[actuators])
        followed = np.where(held, of_cables.FOLLOWED, 0)
        followed[tied] = of_cables.TIED
        ints: dict[str, Any] = {"dtype": int, "device": device}
        reals: dict[str, Any] = {"dtype": float, "device": device}
        rows = self._rows = of_cables.CableRows()
        rows.worlds, rows.rest_in_pose = worlds, rest_in_pose
        rows.looks = wp.array(self._look, **ints)
        rows.segments = wp.array([c.segments for c in self._cables], **ints)
        rows.actuators = wp.array(actuators, **ints)
        rows.followed = wp.array(followed, **ints)
        rows.tied = wp.array(tied.astype(np.int32), **ints)
        rows.rest = wp.array(rest.astype(np.float32), **reals)
        self.values = wp.array(values, **reals)
        rows.prm = matrix(packed.shape[1])
        rows.prm.assign(np.repeat(packed, worlds, axis=0))
        rows.state = matrix(kernel.state_size(most), 2)
        self._is_split = interleaved
        rows.work = matrix(kernel.work_size(most), height=height if interleaved else 1)
        rows.trial, rows.status = matrix(8), wp.zeros(height, **ints)
        rows.place = wp.zeros((2, height, 2), **reals)
        nv = int(self._model.nv)
        is_followed = bool((held & ~tied).any())
        self._needs_qpos0 = not rest_in_pose and (
            is_followed
            or self._paths.lengthens != 0.0
            or (self._paths.led and "clearance" in self.terms)
        )
        rows.slope = wp.zeros((2, 2 * height, nv if is_followed else 0), **reals)
        rows.aim = wp.zeros((height, 9), **reals)
        rows.stamp = wp.full(height, np.inf, **reals)
        rows.now, rows.fresh = wp.zeros(height, **ints), wp.zeros(height, **ints)
        self._flags = wp.ones(worlds, dtype=bool, device=device)
        self.tensions = rows.tensions = wp.zeros((worlds, count, 2), **reals)
        self._led: LedCables | None = None
        if self._paths.led:
            kinds = self.terms, self._implicit, self._paths
            self._led = LedCables(
                self._model, self._cables, self._routes, rows, matrix, kinds
            )
        self._ahead: _LookAhead | None = None
        if self._implicit:
            ends = np.full(self._model.nu, -1, np.int32)
            places = np.arange(actuators.size).reshape(actuators.shape)
            ends[actuators] = np.where(tied, -2, places)
            look_ahead = of_cables.look_ahead_kernel(self.terms, self._paths)
            self._ahead = _LookAhead(d, rows, ends, look_ahead, self._led)

    def _launch(self, kernel: Any, *given: Any) -> None:
        wp.launch(kernel, self._shape, given, device=self._device)

    def _act(self, m: mjw.Model, d: mjw.Data) -> None:
        """Evaluate all cables at the positions in `d`, and write their forces."""
        self.is_evaluated = True
        if self._before is not None:
            self._before(m, d)
        if d.nworld != self._worlds:
            raise CableError(
                f"the data has {d.nworld} worlds, and cables were attached to "
                f"{self._worlds}; attach them to a model of its own"
            )
        if self._needs_qpos0:
            models.require_shared_positions(m)
        own, step = self._kernels, (self._rows, m.opt.timestep)
        moments = self._moments.of(m, d)
        self._launch(
            own.begin, self._rows, d.time, m.opt.timestep, d.actuator_length, d.qvel,
            moments, m.actuator_gear,
        )  # fmt: skip
        if self._led is not None:
            self._led.lead(m, d)
        if self._ahead is not None:
            self._ahead.aim(m, d, moments)
        if not self._is_split:
            self._launch(own.evaluate, *step, d.actuator_force)
        attempts = of_cables.ATTEMPTS if self._implicit else 1
        for attempt in range(attempts if self._is_split else 0):
            self._launch(own.fronts, *step, attempt)
            self._launch(own.graph, *step)
            self._launch(own.commit, *step, attempt, d.actuator_force)
        if self._led is not None:
            # `mujoco_warp` adds passive forces up after its actuators.
            self._led.pull(True, m, d, d.qfrc_passive)

    @property
    def kernels(self) -> dict[str, Any]:
        """Kernels that an evaluation of these cables launches on a GPU, by name."""
        own = self._kernels
        used = {"begin": own.begin, "fronts": own.fronts, "graph": own.graph}
        if self._ahead is not None:
            used |= self._ahead.kernels
        if self._led is not None:
            used |= self._led.kernels
        return used | {"commit": own.commit}

    def reset(self, worlds: ArrayLike | wp.array | None = None) -> None:
        """Set the cables of some worlds to rest at their next evaluation.

        A reset that keeps the time needs it; `mujoco_warp.reset_data` does not.

        Args:
            worlds: flags (worlds,), which may lie on the device; all if omitted.

        Raises:
            CableError: `worlds` are not flags of all worlds.
        """
        flags: Any = np.ones(self._worlds, bool) if worlds is None else worlds
        if not isinstance(flags, wp.array):
            try:
                flags = np.asarray(flags)
            except ValueError:  # rows of unequal length
                flags = np.asarray(None)
        kind = wp.bool if isinstance(flags, wp.array) else np.dtype(bool)
        if flags.dtype != kind or flags.shape != (self._worlds,):
            raise CableError(
                f"worlds is {worlds!r}; it must be true or false for each of the "
                f"{self._worlds} worlds."
            )
        self._flags.assign(flags)
        self._launch(of_cables.forget, self._flags, self._rows.stamp)

    def vary(self, name: str, **parameters: ArrayLike) -> None:
        """Change parameters of a cable, in each world its own; nothing is compiled.

        A changed pretension takes effect at the next reset.

        Args:
            name: the cable.
            parameters: scalar parameters of `Cable`, numbers or arrays (worlds,).

        Raises:
            CableError: an unknown cable or parameter, a value out of its range, or a
                term that is off in the kernel.
        """
        self.values.assign(self._varied(name, parameters))
        self.repack()

    def require_allowed(self, name: str, parameters: Mapping[str, ArrayLike]) -> None:
        """Raise the errors of `vary` for these values, but change nothing."""
        self._varied(name, parameters)

    def _varied(
        self, name: str, parameters: Mapping[str, ArrayLike]
    ) -> NDArray[np.float32]:
        """Return `values` with some parameters of a cable replaced; see `vary`."""
        index = self._index(name)
        values: NDArray[np.float32] = self.values.numpy().copy()
        for key, given in parameters.items():
            if key not in INDEX:
                raise CableError.unknown("parameter", key, list(INDEX))
            wanted = numbers(f"cable {name!r}: {key}", given)
            if wanted.shape not in ((), (1,), (self._worlds,)):
                raise CableError(
                    f"cable {name!r}: {key} has the shape {wanted.shape}; it must be a "
                    f"number, or one for each of the {self._worlds} worlds."
                )
            if key in TERMS and np.any(wanted != 0.0):
                self._require_compiled(name, key)
            values[index, :, INDEX[key]] = wanted
        # As decimals, so that an error shows 0.7 as 0.7, not in single precision.
        rows = np.unique(values[index], axis=0).astype(str).astype(float)
        for row in rows.tolist():
            own = dict(zip(INDEX, row, strict=True))
            try:
                wanted_cable = self._cables[index].replace(**own)
            except CableError as error:
                raise CableError(f"cable {name!r}: {error}") from None
            self._require_axis_inside_pulley(index, wanted_cable)
        return values

    def assign(self, name: str, cables: Mapping[int, Cable]) -> None:
        """Replace a cable in some worlds, conduits too; nothing is compiled.

        Other worlds stay. A changed pretension takes effect at the next reset.

        Args:
            name: the cable.
            cables: cables by world, with as many segments as the attached one.

        Raises:
            CableError: an unknown cable or world, a term that is off in the kernel,
                another kind of cable, or one so stiff that its ends would need
                implicit steps.
        """
        index = self._index(name)
        own = self._cables[index]
        if not isinstance(cables, Mapping):
            raise CableError(f"cables must be a cable by world, not {shown(cables)}")
        known = Parameter("world", low=0, high=self._worlds - 1, whole=True)
        for world, cable in cables.items():
            if not known.admits(world):
                raise CableError(
                    f"cable {name!r}: world {shown(world)} is not one of 0 to "
                    f"{self._worlds - 1}"
                )
            require_kind(f"cable {name!r}: world {world}", cable, Cable)
        given = np.zeros((len(cables), self._rows.prm.shape[1]), np.float32)
        for row, cable in zip(given, cables.values(), strict=True):
            kinds = ("segments", "bend", "path", "route", "mouth", "guides", "ends")
            for key in kinds:
                if getattr(cable, key) != getattr(own, key):
                    raise CableError(
                        f"cable {name!r}: {key} must stay {getattr(own, key)!r}, as it "
                        f"was attached, not {getattr(cable, key)!r}"
                    )
            for term in cable.terms:
                self._require_compiled(name, term)
            self._require_axis_inside_pulley(index, cable)
            self._require_followed(index, cable)
            packed = self._packed(index, cable)
            row[: packed.size] = packed
        worlds = np.fromiter(cables, np.int32, len(cables))
        rows = index * self._worlds + worlds
        write_rows(self._rows.prm, rows, given)
        route = self._routes[index]
        if route is not None and self._led is not None and cables:
            paths = [self._led.reference_row(route, own) for own in cables.values()]
            write_rows(self._led.reference, rows, np.stack(paths))
        write_rows(self.values[index], worlds, given[:, : at.SCALARS])

    def repack(self) -> None:
        """Apply changes of `values`, unchecked; it can be captured in a graph."""
        rows = self._rows
        self._launch(self._kernels.repack, rows.segments, self.values, rows.prm)
        if self._led is not None:
            self._led.repack(self.values)

    def _require_compiled(self, name: str, term: str) -> None:
        if term not in self.terms:
            raise CableError(
                f"cable {name!r}: {term} was off when the kernel was compiled; "
                f"attach with terms=({term!r},) to vary it"
            )

    def _require_followed(self, index: int, cable: Cable) -> None:
        """Require that ends attached as explicit stay stable with this cable."""
        if (
            self._look[index]
            or self._stiffness(cable, index) <= NEWMARK.stability_limit
        ):
            return
        raise CableError(
            f"cable {self.names[index]!r}: an axial_stiffness of "
            f"{cable.axial_stiffness:g} N is too much for ends that do not look ahead; "
            "attach the cable that is stiffest, or shorten the time step"
        )

    def _require_axis_inside_pulley(self, index: int, cable: Cable) -> None:
        swing = cable.eccentricity + cable.ovality
        radius = abs(float(self._model.actuator_gear[self._actuators_of[index][0], 0]))
        if swing >= radius:
            raise CableError(
                f"cable {self.names[index]!r}: eccentricity and ovality are "
                f"{swing:g} m together; they must be less than the radius of the "
                f"pulley, {radius:g} m"
            )

    def read(self, name: str) -> reading.CableReading:
        """Return the state of a cable in all worlds, as `cc_mujoco.read` does.

        Arrays have the worlds as their first axis; they are copies.

        Raises:
            CableError: there is no cable of that name.
        """
        index = self._index(name)
        cable, states = self._cables[index], self._pending(index)
        if cable.path == PATHS[0] or self._led is None:
            return reading.read_states(states, 0, reading.guided_compliance(cable))
        lengths = self._pending_path(index)[:, : cable.segments + 1]
        packed = self._packed(index, cable)
        compliance, strain = reading.slack_compliance(cable, packed)
        start = states.shape[1]
        return reading.read_states(
            np.hstack([states, lengths]), 0, compliance, strain, lengths=start
        )

    def plugin_state(self) -> FloatArray:
        """Return a copy of the states in the plugin's layout (worlds, npluginstate).

        Raises:
            CableError: cables were attached by name, to a model without the plugin.
        """
        if self._model.npluginstate == 0:
            raise CableError("the model of these cables has no state of a plugin")
        # The plugin needs a newer MuJoCo than cables attached by name.
        from cc_mujoco.plugin._instance_data import Commitment

        found = np.zeros((self._worlds, self._model.npluginstate))
        for index, actuators in enumerate(self._actuators_of):
            state = self._pending(index)
            instance = self._model.actuator_plugin[actuators[0]]
            start = int(self._model.plugin_stateadr[instance])
            found[:, start : start + state.shape[1]] = state
            ends = start + state.shape[1] + Commitment.ends.offset // 8
            found[:, ends : ends + 2] = state[:, :2]
            if self._cables[index].path != PATHS[0]:
                path = self._pending_path(index)
                start += state.shape[1] + reading.PATH_MEMORY
                found[:, start : start + path.shape[1]] = path
        return found

    def _pending(self, index: int) -> FloatArray:
        size = kernel.state_size(self._cables[index].segments)
        return self._pending_rows(self._rows.state, index, size)

    def _pending_path(self, index: int) -> FloatArray:
        assert self._led is not None
        return self._pending_rows(self._led.memory, index, self._led.memory_size(index))

    def _pending_rows(self, both: Any, index: int, size: int) -> FloatArray:
        rows = slice(index * self._worlds, (index + 1) * self._worlds)
        states = both[:, rows, :size].numpy()
        pending = 1 - self._rows.now[rows].numpy()
        found: FloatArray = states[pending, np.arange(self._worlds)].astype(float)
        return found

    def _index(self, name: str) -> int:
        if name not in self.names:
            raise CableError.unknown("cable", name, list(self.names))
        return self.names.index(name)


class _LookAhead:
    """Prediction of implicit ends, with the constraint forces of the step before."""

    def __init__(
        self,
        d: mjw.Data,
        rows: of_cables.CableRows,
        ends: NDArray[np.int32],
        look_ahead: Any,
        led: LedCables | None,
    ) -> None:
        """Allocate the arrays; `ends` is what each actuator holds, see `add_forces`."""
        self._rows, self._led = rows, led
        self.kernels = {
            "add_forces": of_cables.add_forces, "moment_row": of_cables.moment_row,
            "look_ahead": look_ahead,
        }  # fmt: skip
        count, worlds, self._device = rows.segments.shape[0], rows.worlds, d.time.device
        self._shape = count, worlds
        shape = 2 * count, worlds, d.qfrc_passive.shape[1]
        self._answers = wp.zeros(shape, dtype=float, device=self._device)
        self._right, self._found = (
            wp.zeros(shape[1:], dtype=float, device=self._device) for _ in range(2)
        )
        self._ends = wp.array(ends, dtype=int, device=self._device)
        # Inertia with the damping that the integrator takes implicitly, factors.
        self._inertia = [wp.zeros_like(a) for a in (d.M, d.qLD, d.qLDiagInv)]

    def aim(self, m: mjw.Model, d: mjw.Data, moments: Any) -> None:
        damped, rows, right = copy(d), self._rows, self._right
        (count, worlds), device = self._shape, self._device
        damped.M, damped.qLD, damped.qLDiagInv = self._inertia
        if int(m.opt.integrator) == mujoco.mjtIntegrator.mjINT_EULER:
            wp.copy(damped.M, d.M)
        else:
            mjw.deriv_smooth_vel(m, d, damped.M)
        mjw.factor_m(m, damped)
        given = [
            rows, self._ends, moments, d.qfrc_passive, d.qfrc_bias, d.qfrc_applied,
            d.qfrc_constraint, d.actuator_force, right,
        ]  # fmt: skip
        wp.launch(of_cables.add_forces, worlds, given, device=device)
        if self._led is not None:
            self._led.pull(False, m, d, right)
        mjw.xfrc_accumulate(m, d, right)
        mjw.solve_m(m, damped, self._found, right)
        for cable in range(count):
            for end in range(2):
                given = [rows, cable, end, moments, right]
                wp.launch(of_cables.moment_row, worlds, given, device=device)
                mjw.solve_m(m, damped, self._answers[2 * cable + end], right)
        given = [rows, m.opt.timestep, moments, self._answers, self._found]
        given.append(d.actuator_velocity)
        kernel = self.kernels["look_ahead"]
        wp.launch(kernel, self._shape, given, device=device)


def _is_interleaved(device: Any) -> bool:
    """Return whether a column of all rows is contiguous, as threads of a GPU need."""
    return not device.is_cpu


def _terms_in_use(cables: tuple[Cable, ...], more: tuple[str, ...]) -> frozenset[str]:
    for name in require_list("terms", more):
        if name not in TERMS:
            raise CableError.unknown("term", name, list(TERMS))
    on = {name for name in TERMS if any(getattr(cable, name) for cable in cables)}
    return frozenset(on | set(more))


def attach(
    m: mjw.Model,
    d: mjw.Data,
    source: mujoco.MjSpec | mujoco.MjModel,
    *,
    cables: Mapping[str, models.HeldCable] | None = None,
    terms: tuple[str, ...] = (),
    rest_in_pose: bool = False,
) -> AttachedCables:
    """Let the cables of a scene act in all worlds of a mujoco_warp model.

    Sets `m.callback.act_bias`; a callback that was there is called before. A cable is
    set to rest where the time of a world is before that of the last evaluation, as
    after `mujoco_warp.reset_data`, and takes one step whenever it is later. Several
    evaluations at the same time count as one.

    Args:
        m: model of `without_plugin(spec)`.
        d: its data.
        source: the scene with its cables, a specification or a compiled model.
        cables: cables by name, where `source` has none: then it is the compiled model
            that `m` was made of, on any release of MuJoCo that mujoco_warp takes.
        terms: parameters of `Cable` that are off and may be switched on by `vary`.
        rest_in_pose: True if a reset sets the cables to their pretension in the pose of
            the world, as `settle` does, instead of in `qpos0`.

    Raises:
        CableError: no cable, an end or integrator that is not supported, or a model
            that is not that of `without_plugin`.
    """
    routes: Mapping[str, Route] = {}
    if cables is None:
        # Of a MuJoCo that can run the plugin, which other scenes do not need.
        scene = import_module("cc_mujoco.warp._spec")
        model, cables, routes = scene.held_cables(source)
    elif isinstance(source, mujoco.MjModel):
        model = source
    else:
        raise CableError(
            "cables given by name are attached to the compiled model that `m` was made "
            f"of, an MjModel, not {type(source).__name__}"
        )
    return AttachedCables(m, d, model, cables, routes, terms, rest_in_pose)
