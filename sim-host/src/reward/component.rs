//! The reference's reward components, lane by lane; each formula is that of the component it names.

use kestrel_core::real::Real;
use nalgebra::Vector3;

use super::{StepView, each};
use crate::scenario::{Area, Component, Field, FrameCount, Growth, Neighbour, RewardTerm, Span};
use crate::swarm::{Column, Swarm, vector};
use crate::termination::{RollPitchLimit, contains};

/// Greatest magnitude of roll and pitch that counts as level \[rad\].
const LEVEL: f64 = 1.0;

impl Component {
    /// Columns that the component remembers an episode by.
    pub(crate) fn memory_len(&self) -> usize {
        match self {
            Self::FieldCoverage(field) => field.len(),
            Self::DropAltitude { .. } | Self::Waypoints(_) => 2,
            Self::DeltaDistance { .. }
            | Self::SafeDeltaDistance { .. }
            | Self::Landing { .. }
            | Self::LandVision { .. }
            | Self::IncreaseXStride { .. } => 1,
            Self::Bounds { .. }
            | Self::Collision { .. }
            | Self::NoCollision { .. }
            | Self::DistanceRoot { .. }
            | Self::SafeDistance { .. }
            | Self::LandingHeight { .. }
            | Self::Orientation
            | Self::Rebase { .. }
            | Self::Slowdown { .. }
            | Self::SpeedLimit { .. }
            | Self::TouchLandingZone
            | Self::EnterArea(_)
            | Self::IncreaseX
            | Self::SquaredDistance
            | Self::QuarticDistance
            | Self::Climb
            | Self::Exit { .. }
            | Self::HeightDifference { .. }
            | Self::Meeting => 0,
        }
    }

    /// Value of the component in every lane, before its weight.
    ///
    /// Not inlined into the kernels: a few operations a lane, which need no copy for every instruction set.
    #[inline(never)]
    pub(super) fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        memory: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let swarm = view.swarm;
        let (zero, one) = (R::zero(), R::one());
        match self {
            Self::Bounds { bounds, growth } => {
                let (low, high) = (bounds.low.map(R::from_f32), bounds.high.map(R::from_f32));
                each(values, |i| {
                    let position = vector(&swarm.position, i);
                    let outside = (0..3).any(|axis| (high[axis] < position[axis]) | (position[axis] < low[axis]));
                    if outside { -growth.factor(view.steps[i]) } else { zero }
                });
            }
            Self::Collision { allowed } => each(values, |i| -collision(view, allowed.as_ref(), i)),
            Self::NoCollision { allowed } => {
                let two = R::from_f64(2.0);
                each(values, |i| one - two * collision(view, allowed.as_ref(), i));
            }
            Self::DeltaDistance { target, span, radius, least } => {
                let (radius, least) = (R::from_f64(*radius), R::from_f64(*least));
                for i in 0..LANES {
                    let distance = span.distance(swarm, target, i);
                    let before = memory[0][i];
                    if distance < radius {
                        values[i] = one;
                    } else {
                        let nearer = if distance - before < -least { one } else { -one };
                        values[i] = if is_unset(before) { zero } else { nearer };
                        memory[0][i] = distance;
                    }
                }
            }
            Self::SafeDeltaDistance { target, delta } => {
                safe_delta(view, target, R::from_f64(*delta), &mut memory[0], values);
            }
            Self::DistanceRoot { target, span } => {
                let five = R::from_f64(5.0);
                each(values, |i| (one - (span.distance(swarm, target, i) / five).sqrt()).at_most(one));
            }
            Self::SafeDistance { target, reach } => {
                let reach = R::from_f64(*reach);
                let exponent = R::from_f64(0.4);
                each(values, |i| {
                    let share = Span::Spatial.distance(swarm, target, i) / reach;
                    (one - (exponent * share.ln()).exp()).limited(zero, one)
                });
            }
            Self::DropAltitude { target, start_distance } => {
                drop_altitude(view, target, R::from_f64(*start_distance), memory, values);
            }
            Self::FieldCoverage(field) => {
                for i in 0..LANES {
                    values[i] = field.visit(swarm, i, memory);
                }
            }
            Self::Landing { target, .. } => landing(view, target, &mut memory[0], values),
            Self::LandingHeight { target } => landing_height(view, target, values),
            Self::Orientation => {
                let limit = RollPitchLimit::new(LEVEL);
                each(values, |i| if limit.holds(swarm, i) { one } else { -one });
            }
            Self::Rebase { target, periods } => each(values, |i| {
                let step = view.steps[i].to_f64() as u64;
                let near = Span::Spatial.distance(swarm, target, i) < R::from_f64(0.125);
                match (step % u64::from(*periods), near) {
                    (0, true) => one,
                    (0, false) => -one,
                    (_, _) => zero,
                }
            }),
            Self::Slowdown { target, distance } => each(values, |i| {
                let near = Span::Spatial.distance(swarm, target, i) < R::from_f64(*distance);
                let speed = planar_length(&vector(&swarm.velocity, i));
                if near { (one - (speed / R::from_f64(5.0)).sqrt()).at_most(one) } else { zero }
            }),
            Self::SpeedLimit { limit } => {
                let limit = R::from_f64(*limit);
                each(values, |i| limit.where_less(length(&vector(&swarm.velocity, i)), -one, zero));
            }
            task => task.evaluate_task(view, memory, values),
        }
    }

    /// As [`Self::evaluate`], of those that belong to a task rather than to a target.
    fn evaluate_task<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        memory: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let swarm = view.swarm;
        let (zero, one) = (R::zero(), R::one());
        match self {
            Self::TouchLandingZone => *values = view.touches[1],
            Self::Waypoints(points) => waypoints(view, points, memory, values),
            Self::EnterArea(area) => each(values, |i| if area.contains(swarm, i) { one } else { zero }),
            Self::IncreaseX => each(values, |i| {
                let x = swarm.position[0][i];
                zero.where_less(x, x / R::from_f64(10.0), zero)
            }),
            Self::IncreaseXStride { delta, from } => {
                increase_x(view, R::from_f64(*delta), from.is_some(), &mut memory[0], values);
            }
            Self::SquaredDistance => each(values, |i| -view.distances[i] * view.distances[i]),
            Self::QuarticDistance => each(values, |i| {
                let square = view.distances[i] * view.distances[i];
                (R::from_f64(2.0) - square * square).at_least(zero)
            }),
            Self::Climb => each(values, |i| {
                let z = swarm.position[2][i];
                z.where_less(R::from_f64(0.02), R::from_f64(-5.0), -one / (R::from_f64(10.0) * z))
            }),
            Self::Exit { region, roll_limit } => each(values, |i| {
                let level = swarm.attitude[1][i].abs() <= R::from_f64(*roll_limit);
                if contains(region, swarm, i) & level { R::from_f64(1000.0) } else { -one }
            }),
            Self::LandVision { target } => land_vision(view, target, &mut memory[0], values),
            Self::HeightDifference { to, factor } => {
                let factor = R::from_f64(*factor);
                let other = match to {
                    Neighbour::First => &view.team[0],
                    Neighbour::Previous => &view.team[view.agent.saturating_sub(1)],
                };
                each(values, |i| {
                    let difference = other[2][i] - swarm.position[2][i];
                    -factor * difference * difference
                });
            }
            Self::Meeting => {
                let other = &view.team[view.team.len() - 1 - view.agent];
                each(values, |i| {
                    let way = vector(other, i) - vector(&swarm.position, i);
                    -((way.x * way.x + way.y * way.y) + way.z * way.z)
                });
            }
            _ => *values = [zero; LANES],
        }
    }
}

impl RewardTerm {
    /// What the columns of a term hold at the start of an episode; NaN means "nothing yet".
    pub(crate) fn memory_start(&self) -> f64 {
        match self {
            Self::Component(
                Component::DeltaDistance { .. }
                | Component::SafeDeltaDistance { .. }
                | Component::DropAltitude { .. }
                | Component::Waypoints(_)
                | Component::IncreaseXStride { from: None, .. },
            )
            | Self::Advance(_) => f64::NAN,
            Self::Component(Component::IncreaseXStride { from: Some(x), .. }) => *x,
            _ => 0.0,
        }
    }

    /// Whether the term remembers beyond the end of an episode.
    pub(crate) fn memory_lasts(&self) -> bool {
        matches!(self, Self::Component(Component::Landing { frames: FrameCount::Lifetime, .. }))
    }
}

impl Growth {
    fn factor<R: Real>(self, step: R) -> R {
        match self {
            Self::Constant => R::one(),
            Self::WithSteps => R::one() - R::one() / step.sqrt(),
        }
    }
}

impl Span {
    #[inline(always)]
    fn distance<const LANES: usize, R: Real>(
        self,
        swarm: &Swarm<LANES, R>,
        target: &Vector3<f64>,
        lane: usize,
    ) -> R {
        let way = vector(&swarm.position, lane) - target.map(R::from_f64);
        match self {
            Self::Planar => planar_length(&way),
            Self::Spatial => length(&way),
        }
    }
}

impl Area {
    #[inline(always)]
    pub(crate) fn contains<const LANES: usize, R: Real>(&self, swarm: &Swarm<LANES, R>, lane: usize) -> bool {
        let (x, y) = (swarm.position[0][lane], swarm.position[1][lane]);
        let within = |[low, high]: [f32; 2], value: R| (R::from_f32(low) < value) & (value < R::from_f32(high));
        within(self.x, x) & within(self.y, y)
    }
}

impl Field {
    /// Cells in all.
    pub(crate) fn len(&self) -> usize {
        (self.cells * self.cells) as usize
    }

    /// Marks the cell below the drone; one if it was new.
    #[inline(always)]
    pub(crate) fn visit<const LANES: usize, R: Real>(
        &self,
        swarm: &Swarm<LANES, R>,
        lane: usize,
        visited: &mut [Column<LANES, R>],
    ) -> R {
        let half = R::from_f64(0.5 * f64::from(self.cells));
        let (x, y) = (swarm.position[0][lane] + half, swarm.position[1][lane] + half);
        let mut fresh = R::zero();
        for (index, cell) in visited.iter_mut().enumerate() {
            let (column, row) = (index as u32 / self.cells, index as u32 % self.cells);
            if self.holds(column, x) & self.holds(row, y) {
                fresh = R::one() - cell[lane];
                cell[lane] = R::one();
            }
        }
        fresh
    }

    /// Whether a coordinate, from the field's border \[m\], belongs to a row of cells.
    #[inline(always)]
    fn holds<R: Real>(&self, row: u32, coordinate: R) -> bool {
        let low = f64::from(row);
        let high = coordinate < R::from_f64(low + 1.0);
        if self.rounds_towards_zero && row == 0 {
            (R::from_f64(-1.0) < coordinate) & high
        } else {
            (R::from_f64(low) <= coordinate) & high
        }
    }
}

/// One in contact outside the area where contact is allowed.
#[inline(always)]
fn collision<const LANES: usize, R: Real>(
    view: &StepView<'_, LANES, R>,
    allowed: Option<&Area>,
    lane: usize,
) -> R {
    match allowed {
        Some(area) if area.contains(view.swarm, lane) => R::zero(),
        Some(_) | None => view.touches[0][lane],
    }
}

fn safe_delta<const LANES: usize, R: Real>(
    view: &StepView<'_, LANES, R>,
    target: &Vector3<f64>,
    delta: R,
    reference: &mut Column<LANES, R>,
    values: &mut Column<LANES, R>,
) {
    let arrived = R::from_f64(0.099);
    for i in 0..LANES {
        let distance = Span::Spatial.distance(view.swarm, target, i);
        let unset = is_unset(reference[i]);
        let nearer = delta < reference[i] - distance;
        let there = distance < arrived;
        values[i] = if there | nearer { R::one() } else { R::zero() };
        reference[i] = if (unset | nearer) & !there { distance } else { reference[i] };
    }
}

fn drop_altitude<const LANES: usize, R: Real>(
    view: &StepView<'_, LANES, R>,
    target: &Vector3<f64>,
    start_distance: R,
    memory: &mut [Column<LANES, R>],
    values: &mut Column<LANES, R>,
) {
    for i in 0..LANES {
        let height = view.swarm.position[2][i];
        let before = memory[0][i];
        if Span::Planar.distance(view.swarm, target, i) < start_distance {
            let rising = before + R::from_f64(1e-6) < height;
            values[i] = if rising { -R::one() } else { R::one() };
            memory[0][i] = height;
        } else {
            values[i] = R::zero();
            memory[0][i] = R::from_f64(f64::NAN);
        }
    }
}

fn landing<const LANES: usize, R: Real>(
    view: &StepView<'_, LANES, R>,
    target: &Vector3<f64>,
    frames: &mut Column<LANES, R>,
    values: &mut Column<LANES, R>,
) {
    for i in 0..LANES {
        let above = Span::Planar.distance(view.swarm, target, i) < R::from_f64(0.15);
        frames[i] += if above { R::one() } else { R::zero() };
        let off = (view.swarm.position[2][i] - R::from_f64(target.z)).abs();
        let landed = frames[i] >= R::from_f64(10.0);
        values[i] = match (above, landed) {
            (true, true) => R::from_f64(10.0),
            (true, false) => R::one() - off,
            (false, _) => R::zero(),
        };
    }
}

fn landing_height<const LANES: usize, R: Real>(
    view: &StepView<'_, LANES, R>,
    target: &Vector3<f64>,
    values: &mut Column<LANES, R>,
) {
    let limit = RollPitchLimit::new(LEVEL);
    let height = R::from_f64(target.z);
    let span = R::one() - height;
    for i in 0..LANES {
        let z = view.swarm.position[2][i];
        let above = Span::Planar.distance(view.swarm, target, i) < R::from_f64(0.099);
        let there = (z - height).abs() < R::from_f64(0.01) * height;
        let worth = if there { R::one() } else { (span - (z - height)) / span };
        values[i] = if above & limit.holds(view.swarm, i) { worth } else { R::zero() };
    }
}

/// Memory: index of the next waypoint, distance to it when it became the next.
fn waypoints<const LANES: usize, R: Real>(
    view: &StepView<'_, LANES, R>,
    points: &[Vector3<f64>],
    memory: &mut [Column<LANES, R>],
    values: &mut Column<LANES, R>,
) {
    for i in 0..LANES {
        let unset = is_unset(memory[0][i]);
        let next = if unset { 0 } else { memory[0][i].to_f64() as usize };
        let distance = Span::Spatial.distance(view.swarm, &points[next], i);
        let first = if unset { distance } else { memory[1][i] };
        let arrived = distance <= R::from_f64(0.707);
        values[i] = if arrived { R::one() } else { first - distance };
        let following = if arrived { (next + 1).min(points.len() - 1) } else { next };
        memory[0][i] = R::from_f64(following as f64);
        memory[1][i] =
            if following == next { first } else { Span::Spatial.distance(view.swarm, &points[following], i) };
    }
}

fn increase_x<const LANES: usize, R: Real>(
    view: &StepView<'_, LANES, R>,
    delta: R,
    begins_there: bool,
    greatest: &mut Column<LANES, R>,
    values: &mut Column<LANES, R>,
) {
    for i in 0..LANES {
        let x = view.swarm.position[0][i];
        let farther = greatest[i] + delta < x;
        let unset = !begins_there & is_unset(greatest[i]);
        values[i] = if farther { R::one() } else { R::zero() };
        greatest[i] = if farther | unset { x } else { greatest[i] };
    }
}

fn land_vision<const LANES: usize, R: Real>(
    view: &StepView<'_, LANES, R>,
    target: &Vector3<f64>,
    frames: &mut Column<LANES, R>,
    values: &mut Column<LANES, R>,
) {
    let real = R::from_f64;
    for i in 0..LANES {
        let distance = Span::Spatial.distance(view.swarm, target, i);
        let speed = length(&vector(&view.swarm.velocity, i));
        let lost = real(0.5) < view.ends.failure[i] + view.ends.time_up[i];
        values[i] = if (distance < real(0.1)) & (speed < real(0.1)) {
            frames[i] += R::one();
            if frames[i] >= real(10.0) { real(2240.0) } else { real(80.0) }
        } else if distance < R::one() {
            let pace = if speed < R::one() { real(2.0) - speed } else { R::one() / speed };
            real(2.0) - real(0.15) * pace
        } else if lost {
            real(-240.0)
        } else {
            R::one() / distance
        };
    }
}

/// Whether a column remembers nothing yet.
#[inline(always)]
pub(super) fn is_unset<R: Real>(value: R) -> bool {
    value.to_f64().is_nan()
}

#[inline(always)]
fn planar_length<R: Real>(vector: &Vector3<R>) -> R {
    (vector.x * vector.x + vector.y * vector.y).sqrt()
}

#[inline(always)]
fn length<R: Real>(vector: &Vector3<R>) -> R {
    ((vector.x * vector.x + vector.y * vector.y) + vector.z * vector.z).sqrt()
}
