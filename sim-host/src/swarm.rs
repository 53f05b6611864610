//! Many drones as columns: lane `i` of every column belongs to drone `i`.

use kestrel_core::airframe::Airframe;
use kestrel_core::attitude::Attitude;
use kestrel_core::bullet::{Bullet, BulletState, Mode, Quirks};
use kestrel_core::downwash::downwash_force;
use kestrel_core::dynamics::Integrator::{self, RungeKutta4, SemiImplicitEuler};
use kestrel_core::real::Real;
use kestrel_core::vehicle::Ground::{self, Distant, Near};
use kestrel_core::vehicle::{Air, State, Vehicle};
use nalgebra::Vector3;
use pulp::{Simd, WithSimd};

use crate::scenario::{Physics, Preset};

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
    /// Attitude of the links, in the `bullet` preset.
    link_attitude: [Column<LANES, R>; 4],
    /// Angular velocity as the `bullet` preset reports it \[rad/s\], world.
    reported: [Column<LANES, R>; 3],
    /// Push of the drones above \[N\]: the downward force.
    downwash: Column<LANES, R>,
    airframe: Airframe,
    nominal: Vehicle<R>,
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
            link_attitude: level,
            reported: [nothing; 3],
            downwash: nothing,
            airframe: *airframe,
            nominal: Vehicle::new(airframe),
        };
        let nominal = swarm.nominal;
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

    #[inline(always)]
    pub(crate) fn set_drone(&mut self, lane: usize, drone: &BulletState<R>) {
        let Attitude { w, x, y, z } = drone.link_attitude;
        self.set_state(lane, &drone.motion);
        set_row(&mut self.link_attitude, lane, [w, x, y, z]);
        set_row(&mut self.reported, lane, drone.reported_angular_velocity.into());
    }

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
    }

    /// Advances every drone by one substep with rotor targets held; with downwash, `team` are the positions of all
    /// drones of the same environments at its start.
    #[inline(always)]
    pub(crate) fn advance(
        &mut self,
        physics: &Physics,
        targets: &[Column<LANES, R>; 4],
        team: &[[Column<LANES, R>; 3]],
    ) {
        let secs = R::from_f64(physics.substep_secs());
        if physics.has_downwash() {
            self.feel_downwash(physics, team);
        }
        // The choices are spelled out as constants, so that the loop over lanes has no branch and vectorises.
        match physics.preset {
            Preset::Clean { integrator, ground, .. } => match (integrator, ground) {
                (SemiImplicitEuler, Distant) => self.advance_clean(SemiImplicitEuler, Distant, secs, targets),
                (SemiImplicitEuler, Near) => self.advance_clean(SemiImplicitEuler, Near, secs, targets),
                (RungeKutta4, Distant) => self.advance_clean(RungeKutta4, Distant, secs, targets),
                (RungeKutta4, Near) => self.advance_clean(RungeKutta4, Near, secs, targets),
            },
            Preset::Bullet { mode, quirks } => {
                let bullet = Bullet::new(&self.airframe, mode, quirks);
                if mode == Mode::Pyb && quirks == Quirks::fork() {
                    let bullet = Bullet { mode: Mode::Pyb, quirks: Quirks::fork(), ..bullet };
                    self.advance_bullet(&bullet, secs, targets);
                } else if mode == Mode::Pyb && quirks == Quirks::upstream() {
                    let bullet = Bullet { mode: Mode::Pyb, quirks: Quirks::upstream(), ..bullet };
                    self.advance_bullet(&bullet, secs, targets);
                } else {
                    self.advance_bullet(&bullet, secs, targets);
                }
            }
        }
    }

    #[inline(always)]
    fn advance_clean(&mut self, integrator: Integrator, ground: Ground, secs: R, targets: &[Column<LANES, R>; 4]) {
        // A copy, which no store to a column can change: the loop reads it once.
        let nominal = self.nominal;
        for lane in 0..LANES {
            let air = self.air(ground, lane);
            let (vehicle, state) = (self.vehicle(&nominal, lane), self.state(lane));
            let next = integrator.advance(&vehicle, &state, &row(targets, lane), &air, secs);
            self.set_state(lane, &next);
        }
    }

    #[inline(always)]
    fn advance_bullet(&mut self, bullet: &Bullet<R>, secs: R, targets: &[Column<LANES, R>; 4]) {
        let bullet = *bullet;
        for lane in 0..LANES {
            let next = bullet.step_under(&self.drone(lane), &row(targets, lane), self.downwash[lane], secs);
            self.set_drone(lane, &next);
        }
    }

    #[inline(always)]
    fn air(&self, ground: Ground, lane: usize) -> Air<R> {
        let zero = R::zero();
        Air { wind: vector(&self.wind, lane), force: Vector3::new(zero, zero, -self.downwash[lane]), ground }
    }

    /// Sums what the drones above push down with.
    #[inline(always)]
    fn feel_downwash(&mut self, physics: &Physics, team: &[[Column<LANES, R>; 3]]) {
        let airframe = self.airframe;
        let [x, y, z] = self.position;
        let mut push = [R::zero(); LANES];
        match physics.preset {
            Preset::Clean { .. } => {
                for [ox, oy, oz] in team {
                    for lane in 0..LANES {
                        let offset = Vector3::new(x[lane] - ox[lane], y[lane] - oy[lane], z[lane] - oz[lane]);
                        push[lane] -= downwash_force(&airframe, &offset).z;
                    }
                }
            }
            Preset::Bullet { mode, quirks } => {
                let bullet = Bullet::new(&airframe, mode, quirks);
                for [ox, oy, oz] in team {
                    for lane in 0..LANES {
                        let position = Vector3::new(x[lane], y[lane], z[lane]);
                        let other = Vector3::new(ox[lane], oy[lane], oz[lane]);
                        push[lane] += bullet.downwash(&position, &other);
                    }
                }
            }
        }
        self.downwash = push;
    }

    /// One substep of the drone that stands at `drone` in a lane, the same as [`Self::advance`] makes; `team` are the
    /// positions of all drones of its environment.
    pub(crate) fn advanced(
        &self,
        physics: &Physics,
        lane: usize,
        drone: &BulletState<R>,
        targets: &[R; 4],
        team: &[Vector3<R>],
    ) -> BulletState<R> {
        let mut lone = Swarm::<1, R>::new(&self.airframe);
        lone.set_drone(0, drone);
        lone.gains = self.gains.map(|column| [column[lane]]);
        lone.wind = self.wind.map(|column| [column[lane]]);
        let team: Vec<[Column<1, R>; 3]> = team.iter().map(|place| [[place.x], [place.y], [place.z]]).collect();
        lone.advance(physics, &targets.map(|target| [target]), &team);
        lone.drone(0)
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
            .chain(&mut self.link_attitude)
            .chain(&mut self.reported)
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
    pulp::Arch::new().dispatch(AdvanceAll { swarms, physics, targets, steps });
}

struct AdvanceAll<'a, const LANES: usize> {
    swarms: &'a mut [Swarm<LANES>],
    physics: &'a Physics,
    targets: &'a [Column<LANES>; 4],
    steps: u32,
}

impl<const LANES: usize> WithSimd for AdvanceAll<'_, LANES> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _simd: S) {
        for swarm in self.swarms {
            for _ in 0..self.steps {
                swarm.advance(self.physics, self.targets, &[]);
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
