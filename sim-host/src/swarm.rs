//! Many drones as columns: lane `i` of every column belongs to drone `i`.

use kestrel_core::airframe::Airframe;
use kestrel_core::attitude::Attitude;
use kestrel_core::dynamics::Integrator::{self, RungeKutta4, SemiImplicitEuler};
use kestrel_core::vehicle::Ground::{self, Distant, Near};
use kestrel_core::vehicle::{Air, State, Vehicle};
use nalgebra::Vector3;
use pulp::{Simd, WithSimd};

use crate::scenario::Physics;

/// One value per lane.
pub(crate) type Column<const LANES: usize> = [f32; LANES];

/// States and parameters of `LANES` drones that fly in air without bounds.
#[derive(Clone, Debug)]
pub struct Swarm<const LANES: usize> {
    pub(crate) position: [Column<LANES>; 3],
    pub(crate) attitude: [Column<LANES>; 4],
    pub(crate) velocity: [Column<LANES>; 3],
    pub(crate) body_rates: [Column<LANES>; 3],
    pub(crate) rotor_speeds: [Column<LANES>; 4],
    pub(crate) wind: [Column<LANES>; 3],
    /// The fields of [`Vehicle`] that randomisation touches, in the order of `Swarm::vehicle`.
    pub(crate) gains: [Column<LANES>; 12],
    nominal: Vehicle<f32>,
}

impl<const LANES: usize> Swarm<LANES> {
    /// Nominal drones at the origin: level, still, rotors stopped.
    pub fn new(airframe: &Airframe) -> Self {
        let nothing = [0.0; LANES];
        let mut swarm = Self {
            position: [nothing; 3],
            attitude: [[1.0; LANES], nothing, nothing, nothing],
            velocity: [nothing; 3],
            body_rates: [nothing; 3],
            rotor_speeds: [nothing; 4],
            wind: [nothing; 3],
            gains: [nothing; 12],
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
    pub fn state(&self, lane: usize) -> State<f32> {
        let [w, x, y, z] = &self.attitude;
        State {
            position: vector(&self.position, lane),
            world_from_body: Attitude { w: w[lane], x: x[lane], y: y[lane], z: z[lane] },
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
    pub fn set_state(&mut self, lane: usize, state: &State<f32>) {
        let Attitude { w, x, y, z } = state.world_from_body;
        set_row(&mut self.position, lane, state.position.into());
        set_row(&mut self.attitude, lane, [w, x, y, z]);
        set_row(&mut self.velocity, lane, state.velocity.into());
        set_row(&mut self.body_rates, lane, state.body_rates.into());
        set_row(&mut self.rotor_speeds, lane, state.rotor_speeds);
    }

    #[inline(always)]
    fn vehicle(&self, nominal: &Vehicle<f32>, lane: usize) -> Vehicle<f32> {
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

    pub(crate) fn set_vehicle(&mut self, lane: usize, vehicle: &Vehicle<f32>) {
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

    /// Advances every drone by one substep with rotor targets held.
    #[inline(always)]
    pub(crate) fn advance(&mut self, physics: &Physics, targets: &[Column<LANES>; 4]) {
        // The choices are spelled out as constants, so that the loop over lanes has no branch and vectorises.
        let secs = physics.substep_secs();
        match (physics.integrator, physics.ground) {
            (SemiImplicitEuler, Distant) => self.advance_lanes(SemiImplicitEuler, Distant, secs, targets),
            (SemiImplicitEuler, Near) => self.advance_lanes(SemiImplicitEuler, Near, secs, targets),
            (RungeKutta4, Distant) => self.advance_lanes(RungeKutta4, Distant, secs, targets),
            (RungeKutta4, Near) => self.advance_lanes(RungeKutta4, Near, secs, targets),
        }
    }

    #[inline(always)]
    fn advance_lanes(&mut self, integrator: Integrator, ground: Ground, secs: f32, targets: &[Column<LANES>; 4]) {
        // A copy, which no store to a column can change: the loop reads it once.
        let nominal = self.nominal;
        for lane in 0..LANES {
            let air = Air { wind: vector(&self.wind, lane), force: Vector3::new(0.0, 0.0, 0.0), ground };
            let (vehicle, state) = (self.vehicle(&nominal, lane), self.state(lane));
            let next = integrator.advance(&vehicle, &state, &row(targets, lane), &air, secs);
            self.set_state(lane, &next);
        }
    }

    /// Every column, for saving and restoring.
    pub(crate) fn columns_mut(&mut self) -> impl Iterator<Item = &mut Column<LANES>> {
        self.position
            .iter_mut()
            .chain(&mut self.attitude)
            .chain(&mut self.velocity)
            .chain(&mut self.body_rates)
            .chain(&mut self.rotor_speeds)
            .chain(&mut self.wind)
            .chain(&mut self.gains)
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
                swarm.advance(self.physics, self.targets);
            }
        }
    }
}

/// The values of one lane.
#[inline(always)]
pub(crate) fn row<const LANES: usize, const N: usize>(columns: &[Column<LANES>; N], lane: usize) -> [f32; N] {
    core::array::from_fn(|i| columns[i][lane])
}

/// Writes the values of one lane.
#[inline(always)]
pub(crate) fn set_row<const LANES: usize, const N: usize>(
    columns: &mut [Column<LANES>; N],
    lane: usize,
    values: [f32; N],
) {
    for (column, value) in columns.iter_mut().zip(values) {
        column[lane] = value;
    }
}

#[inline(always)]
pub(crate) fn vector<const LANES: usize>(columns: &[Column<LANES>; 3], lane: usize) -> Vector3<f32> {
    Vector3::new(columns[0][lane], columns[1][lane], columns[2][lane])
}
