//! All drones of a block, as columns: lane `i` of every column belongs to drone `i`.

use kestrel_core::airframe::Airframe;
use kestrel_core::attitude::Attitude;
use kestrel_core::vehicle::{State, Vehicle};
use nalgebra::Vector3;

/// One value per lane.
pub(crate) type Column<const LANES: usize> = [f32; LANES];

/// States and parameters of `LANES` drones.
#[derive(Clone, Debug)]
pub(crate) struct Swarm<const LANES: usize> {
    pub(crate) position: [Column<LANES>; 3],
    pub(crate) attitude: [Column<LANES>; 4],
    pub(crate) velocity: [Column<LANES>; 3],
    pub(crate) body_rates: [Column<LANES>; 3],
    pub(crate) rotor_speeds: [Column<LANES>; 4],
    pub(crate) wind: [Column<LANES>; 3],
    /// The fields of [`Vehicle`] that randomisation touches, in the order of [`Swarm::vehicle`].
    pub(crate) gains: [Column<LANES>; 11],
    nominal: Vehicle<f32>,
}

impl<const LANES: usize> Swarm<LANES> {
    /// Nominal drones at rest at the origin.
    pub(crate) fn new(airframe: &Airframe) -> Self {
        let nothing = [0.0; LANES];
        let mut swarm = Self {
            position: [nothing; 3],
            attitude: [[1.0; LANES], nothing, nothing, nothing],
            velocity: [nothing; 3],
            body_rates: [nothing; 3],
            rotor_speeds: [nothing; 4],
            wind: [nothing; 3],
            gains: [nothing; 11],
            nominal: Vehicle::new(airframe),
        };
        let nominal = swarm.nominal;
        for lane in 0..LANES {
            swarm.set_vehicle(lane, &nominal);
        }
        swarm
    }

    #[inline(always)]
    pub(crate) fn state(&self, lane: usize) -> State<f32> {
        let [w, x, y, z] = &self.attitude;
        State {
            position: vector(&self.position, lane),
            world_from_body: Attitude { w: w[lane], x: x[lane], y: y[lane], z: z[lane] },
            velocity: vector(&self.velocity, lane),
            body_rates: vector(&self.body_rates, lane),
            rotor_speeds: row(&self.rotor_speeds, lane),
        }
    }

    #[inline(always)]
    pub(crate) fn set_state(&mut self, lane: usize, state: &State<f32>) {
        let Attitude { w, x, y, z } = state.world_from_body;
        set_row(&mut self.position, lane, state.position.into());
        set_row(&mut self.attitude, lane, [w, x, y, z]);
        set_row(&mut self.velocity, lane, state.velocity.into());
        set_row(&mut self.body_rates, lane, state.body_rates.into());
        set_row(&mut self.rotor_speeds, lane, state.rotor_speeds);
    }

    #[inline(always)]
    pub(crate) fn vehicle(&self, lane: usize) -> Vehicle<f32> {
        let [mass, thrust, roll, pitch, yaw, gx, gy, gz, rise, fall, drag] = &self.gains;
        Vehicle {
            inverse_mass: mass[lane],
            thrust_gain: thrust[lane],
            turning_gains: Vector3::new(roll[lane], pitch[lane], yaw[lane]),
            gyroscopic: Vector3::new(gx[lane], gy[lane], gz[lane]),
            rotor_rise_rate: rise[lane],
            rotor_fall_rate: fall[lane],
            planar_drag: drag[lane],
            ..self.nominal
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
        ];
        set_row(&mut self.gains, lane, values);
    }

    #[inline(always)]
    pub(crate) fn wind(&self, lane: usize) -> Vector3<f32> {
        vector(&self.wind, lane)
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
