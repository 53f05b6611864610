use crate::term::prelude::*;

/// Mechanical power of the rotors in watts, torque times speed: an episode costs the energy in joules that it takes.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Energy {
    /// What one unit is worth.
    pub weight: f64,
}

impl Term for Energy {
    const PAID: Paid = Paid::PerSecond;

    #[inline(always)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let torque = R::from_f64(view.swarm.airframe().torque_coefficient.abs());
        each(values, |i| {
            let cube = |speeds: &Column<LANES, R>| speeds[i] * speeds[i] * speeds[i];
            let [a, b, c, d] = view.swarm.rotor_speeds.each_ref().map(cube);
            worth * torque * ((a + b) + (c + d))
        });
    }
}

#[cfg(test)]
mod tests {
    use kestrel_core::airframe::CF2X;

    use super::super::trial::{Trial, assert_near};

    #[test]
    fn power_is_the_rotors_torque_times_their_speed() {
        let mut trial = Trial::of("energy: { weight: -1 }");
        assert_near(trial.pay(), 0.0);
        let speed = CF2X.hover_rotor_speed();
        trial.swarm.rotor_speeds = [[speed], [speed], [speed], [0.5 * speed]];
        // Three rotors at full power, and one at an eighth.
        let power = 3.125 * CF2X.torque_coefficient.abs() * speed.powi(3);
        assert_near(trial.pay(), -power / 48.0);
    }
}
