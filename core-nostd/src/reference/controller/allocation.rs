//! From thrust and torques to rotor speeds, with non-negative least squares where no rotor speeds can do it.

use nalgebra::Vector3;

use crate::airframe::{Airframe, Layout};
use crate::real::Real;

/// Thrust along body z and torque on the centre of mass.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Wrench<R> {
    /// \[N\].
    pub thrust: R,
    /// \[N m\], body.
    pub torque: Vector3<R>,
}

/// The matrix of the reference's mixer: four times squared rotor speeds to scaled thrust and torques.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Allocation<R> {
    /// Share of each rotor in thrust and torque about x, y, z; the rows are orthogonal.
    pub shares: [[R; 4]; 4],
    /// Squared rotor speed per thrust \[rad²/(N s²)\] and per torque about x, y, z \[rad²/(N m s²)\].
    pub scales: [R; 4],
}

impl<R: Real> Allocation<R> {
    /// The mixer of an airframe, with the nominal arm as lever.
    pub fn new(airframe: &Airframe) -> Self {
        let positions = airframe.layout.with_arm(1.0).rotor_positions(airframe.rotor_order);
        let shares = [[1.0; 4], positions.map(|[_, y]| y), positions.map(|[x, _]| -x), Layout::TORQUE_SIGNS];
        let tilting = airframe.thrust_coefficient * airframe.arm;
        let scales = [airframe.thrust_coefficient, tilting, tilting, airframe.torque_coefficient];
        Self {
            shares: shares.map(|row| row.map(R::from_f64)),
            scales: scales.map(|coefficient| R::from_f64(1.0 / coefficient)),
        }
    }

    /// Rotor speeds \[rad/s\] of a wrench; where one would have to pull, those of the nearest wrench (of the scaled
    /// one, as the reference measures it). There is no upper limit.
    pub fn rotor_speeds(&self, wrench: &Wrench<R>) -> [R; 4] {
        let Wrench { thrust, torque } = *wrench;
        let [per_thrust, per_roll, per_pitch, per_yaw] = self.scales;
        let wanted = [thrust * per_thrust, torque.x * per_roll, torque.y * per_pitch, torque.z * per_yaw];
        let squares = self.exact(&wanted);
        let pulling = squares.iter().any(|square| *square < R::zero());
        let squares = if pulling { self.nearest(&wanted) } else { squares };
        squares.map(R::sqrt)
    }

    /// Squared rotor speeds that yield the wanted sums, of any sign: orthogonal rows invert by transposition.
    fn exact(&self, wanted: &[R; 4]) -> [R; 4] {
        let scaled: [R; 4] =
            core::array::from_fn(|row| wanted[row] / product(&self.shares[row], &self.shares[row]));
        self.transposed(&scaled)
    }

    fn transposed(&self, values: &[R; 4]) -> [R; 4] {
        core::array::from_fn(|rotor| product(&self.shares.map(|row| row[rotor]), values))
    }

    /// Non-negative squared rotor speeds whose sums are nearest to the wanted ones.
    ///
    /// The solution is the unconstrained one of some subset of rotors, the others standing still; four rotors have
    /// few enough subsets to try all.
    fn nearest(&self, wanted: &[R; 4]) -> [R; 4] {
        let mut best = [R::zero(); 4];
        let mut least = product(wanted, wanted);
        for turning in 1..15_u8 {
            let squares = self.least_squares(wanted, turning);
            let missing = self.missing(wanted, &squares);
            if squares.iter().all(|square| *square >= R::zero()) && missing < least {
                (best, least) = (squares, missing);
            }
        }
        best
    }

    /// Squared distance from the wanted sums.
    fn missing(&self, wanted: &[R; 4], squares: &[R; 4]) -> R {
        let residual: [R; 4] = core::array::from_fn(|row| product(&self.shares[row], squares) - wanted[row]);
        product(&residual, &residual)
    }

    /// Least squares over the rotors whose bits are set in `turning`, by their normal equations.
    fn least_squares(&self, wanted: &[R; 4], turning: u8) -> [R; 4] {
        let turns = |rotor: usize| turning >> rotor & 1 == 1;
        let columns: [[R; 4]; 4] = core::array::from_fn(|rotor| self.shares.map(|row| row[rotor]));
        let mut equations: [[R; 5]; 4] = core::array::from_fn(|row| {
            core::array::from_fn(|column| match column {
                4 if turns(row) => product(&columns[row], wanted),
                0..=3 if turns(row) && turns(column) => product(&columns[row], &columns[column]),
                0..=3 if row == column => R::one(),
                _ => R::zero(),
            })
        });
        solve(&mut equations)
    }
}

/// Gauss–Jordan elimination of a positive definite system, right-hand side last; needs no pivots.
fn solve<R: Real>(equations: &mut [[R; 5]; 4]) -> [R; 4] {
    for pivot in 0..4 {
        let row = equations[pivot].map(|value| value / equations[pivot][pivot]);
        for (other, equation) in equations.iter_mut().enumerate() {
            let factor = equation[pivot];
            *equation = if other == pivot { row } else { core::array::from_fn(|i| equation[i] - factor * row[i]) };
        }
    }
    equations.map(|equation| equation[4])
}

fn product<R: Real>(a: &[R; 4], b: &[R; 4]) -> R {
    (a[0] * b[0] + a[1] * b[1]) + (a[2] * b[2] + a[3] * b[3])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::airframe::{CF2P, CF2X, HUMMINGBIRD, RACER, RotorOrder};
    use crate::reference::bullet::{Bullet, BulletMode, Quirks};
    use proptest::prelude::*;

    #[test]
    fn the_hover_wrench_needs_hover_speeds() {
        for airframe in [CF2X, CF2P, HUMMINGBIRD, RACER] {
            let wrench = Wrench { thrust: airframe.weight(), torque: Vector3::zeros() };
            for speed in Allocation::new(&airframe).rotor_speeds(&wrench) {
                assert!((speed / airframe.hover_rotor_speed() - 1.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn a_torque_turns_the_drone_about_its_axis() {
        for airframe in [CF2X, CF2X.numbered(RotorOrder::CounterClockwise), HUMMINGBIRD, RACER] {
            let torque = Vector3::new(0.02, -0.03, 0.004) * airframe.tilting_torque_limit();
            let speeds = Allocation::new(&airframe).rotor_speeds(&Wrench { thrust: airframe.weight(), torque });
            let bullet = Bullet::<f64>::new(&airframe, BulletMode::Dyn, Quirks::upstream());
            let level = crate::vehicle::State {
                position: Vector3::zeros(),
                world_from_body: crate::attitude::Attitude::level(),
                velocity: Vector3::zeros(),
                body_rates: Vector3::zeros(),
                rotor_speeds: [0.0; 4],
            };
            let turning = bullet
                .step(&crate::reference::bullet::BulletState::placed(level), &speeds, &[], 1.0)
                .motion
                .body_rates;
            let found = turning.component_mul(&Vector3::from(airframe.inertia));
            assert!((found - torque).norm() < 1e-9 * torque.norm());
        }
    }

    proptest! {
        #[test]
        fn the_nearest_wrench_satisfies_the_optimality_conditions(wanted in prop::array::uniform4(-1.0..1.0_f64)) {
            let allocation = Allocation::<f64>::new(&CF2X);
            let squares = allocation.nearest(&wanted);
            let exact = allocation.exact(&wanted);
            prop_assume!(exact.iter().any(|square| *square < 0.0));
            let residual = core::array::from_fn(|row| wanted[row] - product(&allocation.shares[row], &squares));
            for (square, gradient) in squares.into_iter().zip(allocation.transposed(&residual)) {
                prop_assert!(square >= 0.0 && gradient < 1e-9 && (square * gradient).abs() < 1e-9);
            }
        }
    }
}
