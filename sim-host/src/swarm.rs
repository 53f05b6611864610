//! Many drones as columns: lane `i` of every column belongs to drone `i`.

use kestrel_core::airframe::Airframe;
use kestrel_core::attitude::Attitude;
use kestrel_core::downwash::Jet;
use kestrel_core::dynamics::Integrator::{self, RungeKutta4, SemiImplicitEuler};
use kestrel_core::real::Real;
use kestrel_core::reference::bullet::{Bullet, BulletMode, BulletState, Quirks};
use kestrel_core::vehicle::Ground::{self, Distant, Near};
use kestrel_core::vehicle::{Air, EffectGains, State, Vehicle};
use nalgebra::Vector3;
use pulp::{Simd, WithSimd};

use crate::contact::Motion;
use crate::latency::States;
use crate::physics::{Downwash, Physics, Preset};
use crate::simd::Arch;
use crate::world::Pose;

/// One value per lane.
pub(crate) type Column<const LANES: usize, R = f32> = [R; LANES];

/// States and parameters of `LANES` drones that fly in air without bounds.
#[derive(Clone, Debug)]
pub struct Swarm<const LANES: usize, R: Real = f32> {
    pub(crate) position: [Column<LANES, R>; 3],
    pub(crate) attitude: [Column<LANES, R>; 4],
    pub(crate) velocity: [Column<LANES, R>; 3],
    pub(crate) body_rates: [Column<LANES, R>; 3],
    pub(crate) rotor_speeds: [Column<LANES, R>; 4],
    pub(crate) wind: [Column<LANES, R>; 3],
    /// The fields of [`Vehicle`] that randomisation touches, in the order of `Swarm::vehicle`.
    pub(crate) gains: [Column<LANES, R>; 12],
    /// The fields of [`EffectGains`], in the order of [`effect_gains`]; empty where the airframe has no effects.
    effects: Vec<Column<LANES, R>>,
    /// Attitude of the links, in the `bullet` preset.
    link_attitude: [Column<LANES, R>; 4],
    /// Angular velocity as the `bullet` preset reports it \[rad/s\], world.
    reported: [Column<LANES, R>; 3],
    airframe: Airframe,
    nominal: Vehicle<R>,
}

/// Columns of [`EffectGains`].
const EFFECTS: usize = 15;

/// Among them, drag of the body over the mass.
const BODY_DRAG: usize = 8;

/// What stays the same for a substep.
struct Held<'a, const LANES: usize, R> {
    targets: &'a [Column<LANES, R>; 4],
    /// \[N\].
    downwash: &'a Column<LANES, R>,
    secs: R,
}

/// How an airframe advances by a substep: the physics, ready for arithmetic.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Mechanics<R> {
    law: Law<R>,
    secs: R,
}

#[derive(Clone, Copy, Debug)]
enum Law<R> {
    Clean { integrator: Integrator, surfaces: Surfaces<R>, jet: Option<Jet<R>> },
    Bullet(Bullet<R>),
}

/// What is near the rotors.
#[derive(Clone, Copy, Debug)]
struct Surfaces<R> {
    ground: Ground,
    /// Height \[m\].
    ceiling: Option<R>,
}

impl<R: Real> Mechanics<R> {
    pub(crate) fn new(physics: &Physics, airframe: &Airframe) -> Self {
        let law = match physics.preset {
            Preset::Clean { integrator, ground, ceiling, downwash } => {
                let jet = (downwash == Downwash::Felt).then(|| Jet::new(airframe));
                let surfaces = Surfaces { ground, ceiling: ceiling.map(R::from_f64) };
                Law::Clean { integrator, surfaces, jet }
            }
            Preset::Bullet { mode, quirks } => Law::Bullet(Bullet::new(airframe, mode, quirks)),
        };
        Self { law, secs: R::from_f64(physics.substep_secs()) }
    }

    /// Downward push \[N\] of the air of the drones above on each drone of a team; `team` are their positions.
    #[inline(always)]
    pub(crate) fn push_down<const LANES: usize>(
        &self,
        team: &[[Column<LANES, R>; 3]],
        pushes: &mut [Column<LANES, R>],
    ) {
        match self.law {
            Law::Clean { jet: Some(jet), .. } => {
                push_lower(team, pushes, |lower, upper| jet.push(&(lower - upper)));
            }
            Law::Bullet(bullet) if bullet.mode.has_downwash() => {
                push_lower(team, pushes, |lower, upper| bullet.downwash(lower, upper));
            }
            Law::Clean { jet: None, .. } | Law::Bullet(_) => {}
        }
    }
}

/// Sums for each drone what those above it push with; of two drones at most one is pushed.
#[inline(always)]
fn push_lower<const LANES: usize, R: Real>(
    team: &[[Column<LANES, R>; 3]],
    pushes: &mut [Column<LANES, R>],
    push: impl Fn(&Vector3<R>, &Vector3<R>) -> R,
) {
    pushes.fill([R::zero(); LANES]);
    for (index, one) in team.iter().enumerate() {
        let (others, rest) = pushes.split_at_mut(index);
        let own = &mut rest[0];
        for (other, others) in team.iter().zip(others) {
            for lane in 0..LANES {
                let (here, there) = (vector(one, lane), vector(other, lane));
                let zero = R::zero();
                let above = |then: R, otherwise: R| here.z.where_less(there.z, then, otherwise);
                let turned = |low: &Vector3<R>, high: &Vector3<R>| {
                    Vector3::new(above(low.x, high.x), above(low.y, high.y), above(low.z, high.z))
                };
                let force = push(&turned(&here, &there), &turned(&there, &here));
                own[lane] += above(force, zero);
                others[lane] += above(zero, force);
            }
        }
    }
}

impl<const LANES: usize, R: Real> Swarm<LANES, R> {
    /// Nominal drones at the origin: level, still, rotors stopped.
    pub fn new(airframe: &Airframe) -> Self {
        let nothing = [R::zero(); LANES];
        let level = [[R::one(); LANES], nothing, nothing, nothing];
        let mut swarm = Self {
            position: [nothing; 3],
            attitude: level,
            velocity: [nothing; 3],
            body_rates: [nothing; 3],
            rotor_speeds: [nothing; 4],
            wind: [nothing; 3],
            gains: [nothing; 12],
            effects: Vec::new(),
            link_attitude: level,
            reported: [nothing; 3],
            airframe: *airframe,
            nominal: Vehicle::new(airframe),
        };
        let nominal = swarm.nominal;
        if nominal.effects.is_some() {
            swarm.effects = vec![nothing; EFFECTS];
        }
        for lane in 0..LANES {
            swarm.set_vehicle(lane, &nominal);
        }
        swarm
    }

    /// The state of the drone in a lane.
    ///
    /// # Panics
    /// When there is no such lane.
    #[inline(always)]
    pub fn state(&self, lane: usize) -> State<R> {
        State {
            position: vector(&self.position, lane),
            world_from_body: quaternion(&self.attitude, lane),
            velocity: vector(&self.velocity, lane),
            body_rates: vector(&self.body_rates, lane),
            rotor_speeds: row(&self.rotor_speeds, lane),
        }
    }

    /// The states of all drones.
    #[inline(always)]
    pub(crate) fn states(&self) -> States<'_, LANES, R> {
        States {
            position: &self.position,
            attitude: &self.attitude,
            velocity: &self.velocity,
            body_rates: &self.body_rates,
            rotor_speeds: &self.rotor_speeds,
        }
    }

    /// What flies, before randomisation.
    pub fn airframe(&self) -> &Airframe {
        &self.airframe
    }

    /// Where the nose of the drone in a lane points, a unit vector in the world.
    ///
    /// # Panics
    /// When there is no such lane.
    #[inline(always)]
    pub fn forward(&self, lane: usize) -> Vector3<R> {
        quaternion(&self.attitude, lane).rotate(Vector3::new(R::one(), R::zero(), R::zero()))
    }

    /// Replaces the state of the drone in a lane.
    ///
    /// # Panics
    /// When there is no such lane.
    #[inline(always)]
    pub fn set_state(&mut self, lane: usize, state: &State<R>) {
        let Attitude { w, x, y, z } = state.world_from_body;
        set_row(&mut self.position, lane, state.position.into());
        set_row(&mut self.attitude, lane, [w, x, y, z]);
        set_row(&mut self.velocity, lane, state.velocity.into());
        set_row(&mut self.body_rates, lane, state.body_rates.into());
        set_row(&mut self.rotor_speeds, lane, state.rotor_speeds);
    }

    /// The state with what the `bullet` preset remembers besides.
    #[inline(always)]
    pub(crate) fn drone(&self, lane: usize) -> BulletState<R> {
        BulletState {
            motion: self.state(lane),
            link_attitude: quaternion(&self.link_attitude, lane),
            reported_angular_velocity: vector(&self.reported, lane),
        }
    }

    /// What contacts and cameras see of the drone in a lane.
    #[inline(always)]
    pub(crate) fn motion(&self, lane: usize) -> Motion {
        let state = self.state(lane);
        Motion {
            pose: Pose {
                position: state.position.map(Real::to_f64),
                world_from_body: state.world_from_body.map(Real::to_f64),
            },
            velocity: state.velocity.map(Real::to_f64),
            body_rates: state.body_rates.map(Real::to_f64),
        }
    }

    #[inline(always)]
    pub(crate) fn set_drone(&mut self, lane: usize, drone: &BulletState<R>) {
        let Attitude { w, x, y, z } = drone.link_attitude;
        self.set_state(lane, &drone.motion);
        set_row(&mut self.link_attitude, lane, [w, x, y, z]);
        set_row(&mut self.reported, lane, drone.reported_angular_velocity.into());
    }

    /// What flies in a lane, but for its effects.
    #[inline(always)]
    fn vehicle(&self, nominal: &Vehicle<R>, lane: usize) -> Vehicle<R> {
        let [mass, thrust, roll, pitch, yaw, gx, gy, gz, rise, fall, drag, axial] = &self.gains;
        Vehicle {
            inverse_mass: mass[lane],
            thrust_gain: thrust[lane],
            turning_gains: Vector3::new(roll[lane], pitch[lane], yaw[lane]),
            gyroscopic: Vector3::new(gx[lane], gy[lane], gz[lane]),
            rotor_rise_rate: rise[lane],
            rotor_fall_rate: fall[lane],
            planar_drag: drag[lane],
            extra_axial_drag: axial[lane],
            ..*nominal
        }
    }

    pub(crate) fn set_vehicle(&mut self, lane: usize, vehicle: &Vehicle<R>) {
        let (turning, gyroscopic) = (&vehicle.turning_gains, &vehicle.gyroscopic);
        let values = [
            vehicle.inverse_mass,
            vehicle.thrust_gain,
            turning.x,
            turning.y,
            turning.z,
            gyroscopic.x,
            gyroscopic.y,
            gyroscopic.z,
            vehicle.rotor_rise_rate,
            vehicle.rotor_fall_rate,
            vehicle.planar_drag,
            vehicle.extra_axial_drag,
        ];
        set_row(&mut self.gains, lane, values);
        if let (Some(columns), Some(effects)) = (self.effects.first_chunk_mut::<EFFECTS>(), &vehicle.effects) {
            let ([fx, fy], [a, b, c, d]) = (effects.flapping, effects.rotor_thrusts);
            let [dx, dy, dz]: [R; 3] = effects.rate_damping.into();
            let [rx, ry, rz]: [R; 3] = effects.rotor_inertia.into();
            let EffectGains { body_drag, battery, .. } = *effects;
            let battery_sag = effects.battery_sag.unwrap_or(R::zero());
            let values = [fx, fy, dx, dy, dz, rx, ry, rz, body_drag, a, b, c, d, battery, battery_sag];
            set_row(columns, lane, values);
        }
    }

    /// Lets a drone carry so much more \[kg\], at its centre of mass; less, where it is negative.
    pub(crate) fn add_load(&mut self, lane: usize, mass: R) {
        let [inverse_mass, thrust, _, _, _, _, _, _, _, _, drag, axial] = &mut self.gains;
        let share = R::one() / (R::one() + mass * inverse_mass[lane]);
        for gain in [inverse_mass, thrust, drag, axial].into_iter().chain(self.effects.get_mut(BODY_DRAG)) {
            gain[lane] *= share;
        }
    }

    /// Advances every drone by one substep with rotor targets held, under what the drones above push down with
    /// \[N\].
    #[inline(always)]
    pub(crate) fn advance(
        &mut self,
        mechanics: &Mechanics<R>,
        targets: &[Column<LANES, R>; 4],
        downwash: &Column<LANES, R>,
    ) {
        let held = Held { targets, downwash, secs: mechanics.secs };
        // The choices are spelled out as constants, so that the loop over lanes has no branch and vectorises.
        match mechanics.law {
            Law::Clean { integrator, surfaces, .. } => {
                let without = |ground| Surfaces { ground, ceiling: None };
                match (integrator, surfaces.ground, surfaces.ceiling) {
                    (SemiImplicitEuler, Distant, None) => {
                        self.advance_clean(SemiImplicitEuler, without(Distant), &held);
                    }
                    (SemiImplicitEuler, Near, None) => self.advance_clean(SemiImplicitEuler, without(Near), &held),
                    (RungeKutta4, Distant, None) => self.advance_clean(RungeKutta4, without(Distant), &held),
                    (RungeKutta4, Near, None) => self.advance_clean(RungeKutta4, without(Near), &held),
                    (SemiImplicitEuler, _, Some(_)) => self.advance_clean(SemiImplicitEuler, surfaces, &held),
                    (RungeKutta4, _, Some(_)) => self.advance_clean(RungeKutta4, surfaces, &held),
                }
            }
            Law::Bullet(bullet) => {
                let (fork, upstream) = (Quirks::fork(), Quirks::upstream());
                match (bullet.mode, bullet.quirks) {
                    (BulletMode::Pyb, quirks) if quirks == fork => {
                        self.advance_bullet(&Bullet { mode: BulletMode::Pyb, quirks: fork, ..bullet }, &held);
                    }
                    (BulletMode::Pyb, quirks) if quirks == upstream => {
                        self.advance_bullet(&Bullet { mode: BulletMode::Pyb, quirks: upstream, ..bullet }, &held);
                    }
                    (BulletMode::PybDw, quirks) if quirks == fork => {
                        self.advance_bullet(&Bullet { mode: BulletMode::PybDw, quirks: fork, ..bullet }, &held);
                    }
                    (BulletMode::PybDw, quirks) if quirks == upstream => {
                        self.advance_bullet(
                            &Bullet { mode: BulletMode::PybDw, quirks: upstream, ..bullet },
                            &held,
                        );
                    }
                    (_, _) => self.advance_bullet(&bullet, &held),
                }
            }
        }
    }

    #[inline(always)]
    fn advance_clean(&mut self, integrator: Integrator, surfaces: Surfaces<R>, held: &Held<'_, LANES, R>) {
        let effects = core::mem::take(&mut self.effects);
        match effects.first_chunk::<EFFECTS>() {
            None => self.advance_lanes(integrator, surfaces, held, |_| None),
            // As with the choices above: a battery that sags or not is a constant for the loop.
            Some(columns) if self.nominal.effects.is_some_and(|effects| effects.battery_sag.is_some()) => {
                self.advance_lanes(integrator, surfaces, held, |lane| Some(effect_gains(columns, lane)));
            }
            Some(columns) => self.advance_lanes(integrator, surfaces, held, |lane| {
                Some(EffectGains { battery_sag: None, ..effect_gains(columns, lane) })
            }),
        }
        self.effects = effects;
    }

    #[inline(always)]
    fn advance_lanes(
        &mut self,
        integrator: Integrator,
        surfaces: Surfaces<R>,
        held: &Held<'_, LANES, R>,
        effects: impl Fn(usize) -> Option<EffectGains<R>>,
    ) {
        // A copy, which no store to a column can change: the loop reads it once.
        let (nominal, secs, Surfaces { ground, ceiling }) = (self.nominal, held.secs, surfaces);
        for lane in 0..LANES {
            let force = Vector3::new(R::zero(), R::zero(), -held.downwash[lane]);
            let air = Air { wind: vector(&self.wind, lane), force, ground, ceiling };
            let vehicle = Vehicle { effects: effects(lane), ..self.vehicle(&nominal, lane) };
            let state = self.state(lane);
            let next = integrator.advance(&vehicle, &state, &row(held.targets, lane), &air, secs);
            self.set_state(lane, &next);
        }
    }

    #[inline(always)]
    fn advance_bullet(&mut self, bullet: &Bullet<R>, held: &Held<'_, LANES, R>) {
        let (bullet, secs) = (*bullet, held.secs);
        for lane in 0..LANES {
            let (drone, targets) = (self.drone(lane), row(held.targets, lane));
            self.set_drone(lane, &bullet.step_under(&drone, &targets, held.downwash[lane], secs));
        }
    }

    /// The drone in a lane by itself, which advances to the same bits.
    pub(crate) fn alone(&self, lane: usize) -> Swarm<1, R> {
        Swarm {
            position: one_lane(&self.position, lane),
            attitude: one_lane(&self.attitude, lane),
            velocity: one_lane(&self.velocity, lane),
            body_rates: one_lane(&self.body_rates, lane),
            rotor_speeds: one_lane(&self.rotor_speeds, lane),
            wind: one_lane(&self.wind, lane),
            gains: one_lane(&self.gains, lane),
            effects: self.effects.iter().map(|column| [column[lane]]).collect(),
            link_attitude: one_lane(&self.link_attitude, lane),
            reported: one_lane(&self.reported, lane),
            airframe: self.airframe,
            nominal: self.nominal,
        }
    }

    /// Angular velocity \[rad/s\], world, as the `bullet` preset reports it.
    #[inline(always)]
    pub(crate) fn reported(&self, lane: usize) -> Vector3<R> {
        vector(&self.reported, lane)
    }

    /// Every column, for saving and restoring.
    pub(crate) fn columns_mut(&mut self) -> impl Iterator<Item = &mut Column<LANES, R>> {
        self.position
            .iter_mut()
            .chain(&mut self.attitude)
            .chain(&mut self.velocity)
            .chain(&mut self.body_rates)
            .chain(&mut self.rotor_speeds)
            .chain(&mut self.wind)
            .chain(&mut self.gains)
            .chain(&mut self.effects)
            .chain(&mut self.link_attitude)
            .chain(&mut self.reported)
    }
}

/// The effects of the drone in a lane.
#[inline(always)]
fn effect_gains<R: Real, const LANES: usize>(
    columns: &[Column<LANES, R>; EFFECTS],
    lane: usize,
) -> EffectGains<R> {
    let [fx, fy, dx, dy, dz, rx, ry, rz, body_drag, a, b, c, d, battery, battery_sag] = row(columns, lane);
    EffectGains {
        flapping: [fx, fy],
        rate_damping: Vector3::new(dx, dy, dz),
        rotor_inertia: Vector3::new(rx, ry, rz),
        body_drag,
        rotor_thrusts: [a, b, c, d],
        battery,
        battery_sag: Some(battery_sag),
    }
}

/// Advances each swarm by `steps` substeps with its rotor targets `[4][LANES]` \[rad/s\] held, with the best
/// instructions of the processor.
pub fn advance_all<const LANES: usize>(
    swarms: &mut [Swarm<LANES>],
    physics: &Physics,
    targets: &[[f32; LANES]; 4],
    steps: u32,
) {
    let Some(swarm) = swarms.first() else { return };
    let mechanics = Mechanics::new(physics, &swarm.airframe);
    Arch::new().dispatch(AdvanceAll { swarms, mechanics, targets, steps });
}

struct AdvanceAll<'a, const LANES: usize> {
    swarms: &'a mut [Swarm<LANES>],
    mechanics: Mechanics<f32>,
    targets: &'a [Column<LANES>; 4],
    steps: u32,
}

impl<const LANES: usize> WithSimd for AdvanceAll<'_, LANES> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        for swarm in self.swarms {
            for _ in 0..self.steps {
                swarm.advance(&self.mechanics, self.targets, &[0.0; LANES]);
            }
        }
    }
}

/// The values of one lane.
#[inline(always)]
pub(crate) fn row<R: Copy, const LANES: usize, const N: usize>(
    columns: &[Column<LANES, R>; N],
    lane: usize,
) -> [R; N] {
    core::array::from_fn(|i| columns[i][lane])
}

/// One lane of columns as columns.
#[inline(always)]
pub(crate) fn one_lane<R: Copy, const LANES: usize, const N: usize>(
    columns: &[Column<LANES, R>; N],
    lane: usize,
) -> [Column<1, R>; N] {
    row(columns, lane).map(|value| [value])
}

/// Writes the values of one lane.
#[inline(always)]
pub(crate) fn set_row<R: Copy, const LANES: usize, const N: usize>(
    columns: &mut [Column<LANES, R>; N],
    lane: usize,
    values: [R; N],
) {
    for (column, value) in columns.iter_mut().zip(values) {
        column[lane] = value;
    }
}

#[inline(always)]
pub(crate) fn vector<R: Copy, const LANES: usize>(columns: &[Column<LANES, R>; 3], lane: usize) -> Vector3<R> {
    Vector3::new(columns[0][lane], columns[1][lane], columns[2][lane])
}

#[inline(always)]
fn quaternion<R: Copy, const LANES: usize>(columns: &[Column<LANES, R>; 4], lane: usize) -> Attitude<R> {
    Attitude { w: columns[0][lane], x: columns[1][lane], y: columns[2][lane], z: columns[3][lane] }
}
