use crate::term::prelude::*;

/// Angle in radians from the drone's heading to one that is asked for, by the shorter way, from 0 to π. Where that leads to a
/// point, it counts less the more of the way there goes up or down.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct HeadingError {
    /// What one unit is worth.
    pub weight: f64,
    /// The heading that is asked for, counter-clockwise from +x.
    #[serde(default)]
    pub heading_deg: f64,
    /// Whether it is to the point ahead that the sensor `way` shows, in place of a fixed one.
    #[serde(default)]
    pub along_own_way: bool,
}

/// Nearer points \[m\] ask for less.
const NEAR_M: f64 = 0.1;

impl Term for HeadingError {
    const PAID: Paid = Paid::PerSecond;

    fn check(&self, task: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        if self.along_own_way {
            task.needs_own_way(&field.at("along_own_way"))?;
            if self.heading_deg != 0.0 {
                return Err(field.reject("`heading_deg` beside `along_own_way: true`", "one of them"));
            }
        }
        field.at("heading_deg").number(self.heading_deg, &Limits::from(-360.0, 360.0, "degrees")).map(drop)
    }

    #[inline(always)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        if let Some(ahead) = view.ahead.filter(|_| self.along_own_way) {
            let place = &view.swarm.position;
            for (i, value) in values.iter_mut().enumerate() {
                let nose = view.swarm.forward(i);
                let [x, y, z] = [0, 1, 2].map(|axis| ahead[axis][i] - place[axis][i]);
                let level = x * x + y * y;
                let share = level / (level + z * z).at_least(R::from_f64(NEAR_M * NEAR_M));
                let (along, aside) = (x * nose.x + y * nose.y, x * nose.y - y * nose.x);
                *value = worth * share * aside.atan2(along).abs();
            }
            return;
        }
        let (sine, cosine) = R::from_f64(self.heading_deg.to_radians()).sin_cos();
        // A loop, and no closure: one of this size is not inlined, and runs lane by lane.
        for (i, value) in values.iter_mut().enumerate() {
            let nose = view.swarm.forward(i);
            let (along, aside) = (cosine * nose.x + sine * nose.y, cosine * nose.y - sine * nose.x);
            *value = worth * aside.atan2(along).abs();
        }
    }
}

#[cfg(test)]
mod tests {
    use core::f64::consts::PI;

    use super::super::trial::{PITCH, ROLL, Trial, YAW, assert_near, turn};

    #[test]
    fn the_angle_is_taken_by_the_shorter_way() {
        let mut north = Trial::of("heading_error: { weight: 48, heading_deg: 90 }");
        let mut east = Trial::of("heading_error: { weight: 48 }");
        for (heading, from_north, from_east) in
            [(0.0, PI / 2.0, 0.0), (0.7, PI / 2.0 - 0.7, 0.7), (-2.5, PI - 0.929_203_673_205_103_4, 2.5)]
        {
            assert_near(north.turned(turn(YAW, heading)), from_north);
            assert_near(east.turned(turn(YAW, heading)), from_east);
        }
        let mut own = Trial::of("heading_error: { weight: 48, along_own_way: true }");
        own.ahead = Some([[0.0], [2.0], [0.0]]);
        assert_near(own.turned(turn(YAW, 0.7)), PI / 2.0 - 0.7);
        own.ahead = Some([[0.0], [2.0], [-2.0]]);
        assert_near(own.turned(turn(YAW, 0.7)), (PI / 2.0 - 0.7) / 2.0);
        own.ahead = Some([[0.0], [0.05], [0.0]]);
        assert_near(own.turned(turn(YAW, 0.7)), (PI / 2.0 - 0.7) / 4.0);
        // Roll about the nose and a climbing nose leave the heading.
        assert_near(east.turned(turn(ROLL, 1.2)), 0.0);
        assert_near(east.turned(turn(PITCH, -0.8)), 0.0);
    }
}
