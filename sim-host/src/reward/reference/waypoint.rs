use crate::term::prelude::*;

/// Metres nearer to the next waypoint than when it became the next, +1 within 0.707 m of it (`WaypointReward`).
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Waypoint {
    /// What one unit is worth.
    pub weight: f64,
    /// The waypoints, at least one.
    pub waypoints_m: Vec<[f64; 3]>,
}

impl Term for Waypoint {
    const PAID: Paid = Paid::PerStep;

    fn check(&self, _: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        let (points, field) = (&self.waypoints_m, field.at("waypoints_m"));
        if points.is_empty() || points.len() > WAYPOINTS_LIMIT {
            return Err(field.refuse("", format!("a list of 1 to {WAYPOINTS_LIMIT} points")));
        }
        points.iter().enumerate().try_for_each(|(index, point)| field.at(index).place(*point).map(drop))
    }

    fn memory(&self) -> Memory {
        Memory { columns: 2, start: f64::NAN, lasts: false }
    }

    #[inline(never)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        memory: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let to = |index: usize, lane| distance(view.swarm, &Vector3::from(self.waypoints_m[index]), lane);
        // The index of the next waypoint, and the distance to it when it became the next.
        let [next_of, first_of] = memory else { return };
        for lane in 0..LANES {
            let unset = is_unset(next_of[lane]);
            let next = if unset { 0 } else { next_of[lane].to_f64() as usize };
            let distance = to(next, lane);
            let first = if unset { distance } else { first_of[lane] };
            let arrived = distance <= R::from_f64(0.707);
            values[lane] = worth * if arrived { R::one() } else { first - distance };
            let following = if arrived { (next + 1).min(self.waypoints_m.len() - 1) } else { next };
            next_of[lane] = R::from_f64(following as f64);
            first_of[lane] = if following == next { first } else { to(following, lane) };
        }
    }
}

/// Most waypoints of one term.
const WAYPOINTS_LIMIT: usize = 64;
