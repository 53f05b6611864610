//! What ends an episode, what counts as success, and how its time is counted.

use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::area::AreaConfig;
use super::aviary::BoxConfig;
use super::error::ConfigError;
use super::field::{Field, Limits};
use super::geometry::contains;
use super::reward::{PUBLISHED_RATE, PUBLISHED_ROLL, cells_of};
use crate::scenario::{Aviary, Clock, EndRule, Success, Termination, TimeLimit};

const LENGTH: Limits = Limits::above(0.0, 1000.0, "m");
const SPEED: Limits = Limits::above(0.0, 20.0, "m/s");

/// Most terminations.
const TERMINATIONS_LIMIT: usize = 16;

/// What ends an episode before its time; a failure unless it says success.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum TerminationConfig {
    /// The drone touches a solid, the floor or another drone.
    Collision,
    /// The same, except inside an area (`CollisionTerm` with an area).
    CollisionOutside {
        /// Where touching is allowed.
        allowed: AreaConfig,
    },
    /// The centre of mass leaves the box (`BoundsTerm`).
    OutOfBounds(BoxConfig),
    /// The same as a cut-off: the future still has worth.
    CutOutOfBounds(BoxConfig),
    /// The tilt exceeds the limit.
    Tilt {
        /// Greatest tilt.
        limit_deg: f64,
    },
    /// Roll or pitch reaches the limit (`OrientationTerm`, with 1 rad).
    RollPitch {
        /// Greatest magnitude of each, below 90 degrees.
        limit_deg: f64,
        /// Whether it cuts off rather than fails.
        #[serde(default)]
        truncates: bool,
    },
    /// The drone is too far from the goal.
    Distance {
        /// Greatest distance.
        limit_m: f64,
    },
    /// The drone touches the landing zone: success (`TouchLandingZoneTerm`).
    Landing,
    /// The drone is near the goal: success.
    Arrival {
        /// How near.
        radius_m: f64,
    },
    /// The drone is inside an area: success (`EnterAreaTerm`). As published it counts its own calls instead of looking,
    /// and fails the episode in the eleventh step.
    EnterArea {
        /// The area.
        area: AreaConfig,
        /// Whether to keep the defect.
        #[serde(default)]
        as_published: bool,
    },
    /// Every cell of the field was entered: success.
    FieldCovered {
        /// Cells of one metre along each side of the field.
        cells: u64,
        /// Whether a metre beyond the low borders counts, too.
        #[serde(default)]
        as_published: bool,
    },
    /// The station was not visited for too long (`FieldCoverageTerm`). As published control periods are counted as if
    /// there were 240 in a second.
    Fuel {
        /// How long a full tank lasts.
        interval_secs: f64,
        /// Where it is refilled, within 12 cm.
        station_m: [f64; 3],
        /// Whether to keep the defect.
        #[serde(default)]
        as_published: bool,
    },
    /// The drone is at the exit: success. As published the quaternion's x has to be nearly zero, too.
    Exit {
        /// The exit.
        region: BoxConfig,
        /// Whether to keep the defect.
        #[serde(default)]
        as_published: bool,
    },
    /// At rest on the landing zone without a break: touching it, slow, upright: success. It takes contacts that are
    /// solved, or drones fall through.
    Rest {
        /// Greatest speed that counts.
        speed_limit_m_per_s: f64,
        /// Greatest tilt that counts.
        tilt_limit_deg: f64,
        /// For how long.
        rest_secs: f64,
    },
    /// Near the goal and slow for long enough: success.
    Hold {
        /// How near.
        radius_m: f64,
        /// How slow.
        speed_limit_m_per_s: f64,
        /// For how many control periods.
        periods: u64,
    },
}

/// What counts as success.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum SuccessConfig {
    /// Near the goal in time, and staying there to the end of the episode.
    Settle {
        /// How near.
        radius_m: f64,
        /// How soon.
        within_secs: f64,
    },
    /// Inside a region and slow; this ends the episode.
    Reach {
        /// Where the centre of mass must be.
        region: BoxConfig,
        /// Greatest speed that counts.
        speed_limit_m_per_s: f64,
    },
    /// Inside a region for some control periods of an episode that does not fail.
    Visit {
        /// Where the centre of mass must be.
        region: BoxConfig,
        /// How many.
        #[serde(default = "one_period")]
        periods: u64,
    },
    /// One of the terminations that are successes.
    Ending,
}

/// How an episode's time is counted and what its end means.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct ClockConfig {
    /// Whether to count as the reference does: two control periods more, and moving goals one period late.
    pub as_published: bool,
    /// Whether running out of time is terminal, as in those aviaries of the reference that do not say otherwise; the
    /// default cuts the episode off, and its future still has worth.
    pub terminal: bool,
}

fn one_period() -> u64 {
    1
}

impl ClockConfig {
    /// How time is counted, and what its end means.
    pub fn check(self) -> (Clock, TimeLimit) {
        let clock = if self.as_published { Clock::Published } else { Clock::Elapsed };
        (clock, if self.terminal { TimeLimit::Terminates } else { TimeLimit::Truncates })
    }
}

impl TerminationConfig {
    /// The terminations; `control_rate_hz` turns times into control periods.
    ///
    /// # Errors
    /// When there are too many, a number is out of range or the goal itself ends the episode.
    pub fn check_all(
        terminations: &[Self],
        aviary: &Aviary,
        control_rate_hz: f64,
        field: &Field<'_>,
    ) -> Result<Vec<EndRule>, ConfigError> {
        if terminations.len() > TERMINATIONS_LIMIT {
            return Err(field.refuse("", format!("a list of at most {TERMINATIONS_LIMIT}")));
        }
        let check = |(index, each): (usize, &Self)| {
            let rule = each.check(aviary, control_rate_hz, &field.at(index))?;
            Ok(EndRule { rule, truncates: each.truncates() })
        };
        terminations.iter().enumerate().map(check).collect()
    }

    fn truncates(&self) -> bool {
        matches!(self, Self::CutOutOfBounds(_) | Self::RollPitch { truncates: true, .. })
    }

    fn check(&self, aviary: &Aviary, control_rate_hz: f64, field: &Field<'_>) -> Result<Termination, ConfigError> {
        Ok(match self {
            Self::Collision => Termination::Collision { allowed: None },
            Self::CollisionOutside { allowed } => {
                let area = allowed.check(&field.at("collision_outside").at("allowed"))?;
                Termination::Collision { allowed: Some(area) }
            }
            Self::OutOfBounds(bounds) => check_bounds(bounds, aviary, &field.at("out_of_bounds"))?,
            Self::CutOutOfBounds(bounds) => check_bounds(bounds, aviary, &field.at("cut_out_of_bounds"))?,
            Self::Tilt { limit_deg } => {
                let limits = Limits::above(0.0, 180.0, "degrees");
                let limit = field.at("tilt").at("limit_deg").number(*limit_deg, &limits)?;
                Termination::Tilt { limit: limit.to_radians() }
            }
            Self::RollPitch { limit_deg, .. } => {
                let limits = Limits::between(0.0, 90.0, "degrees");
                let limit = field.at("roll_pitch").at("limit_deg").real(*limit_deg, &limits)?;
                Termination::RollPitch { limit: limit.to_radians() }
            }
            Self::Distance { limit_m } => {
                Termination::Distance { limit_m: field.at("distance").at("limit_m").number(*limit_m, &LENGTH)? }
            }
            success_or_fuel => return success_or_fuel.check_success(control_rate_hz, field),
        })
    }

    fn check_success(&self, control_rate_hz: f64, field: &Field<'_>) -> Result<Termination, ConfigError> {
        Ok(match self {
            Self::Arrival { radius_m } => {
                let radius_m = field.at("arrival").at("radius_m").number(*radius_m, &LENGTH)?;
                Termination::Arrival { radius_m }
            }
            Self::EnterArea { area, as_published } => {
                let area = area.check(&field.at("enter_area").at("area"))?;
                if *as_published { Termination::EleventhStep } else { Termination::EnterArea(area) }
            }
            Self::FieldCovered { cells, as_published } => {
                Termination::Coverage(cells_of(*cells, *as_published, &field.at("field_covered"))?)
            }
            Self::Fuel { interval_secs, station_m, as_published } => {
                let field = field.at("fuel");
                let interval = field.at("interval_secs").real(*interval_secs, &Limits::above(0.0, 600.0, "s"))?;
                let rate = if *as_published { PUBLISHED_RATE } else { control_rate_hz };
                Termination::Fuel {
                    periods: (interval * rate).round().max(1.0) as u32,
                    station: station(field.at("station_m").place(*station_m)?, *as_published),
                }
            }
            Self::Exit { region, as_published } => Termination::LevelWithin {
                region: region.check(&field.at("exit").at("region"))?,
                roll_limit: if *as_published { PUBLISHED_ROLL } else { f64::INFINITY },
            },
            Self::Rest { speed_limit_m_per_s, tilt_limit_deg, rest_secs } => {
                let field = field.at("rest");
                let tilt =
                    field.at("tilt_limit_deg").number(*tilt_limit_deg, &Limits::above(0.0, 90.0, "degrees"))?;
                let secs = field.at("rest_secs").real(*rest_secs, &Limits::above(0.0, 600.0, "s"))?;
                Termination::Rest {
                    speed_limit: field.at("speed_limit_m_per_s").number(*speed_limit_m_per_s, &SPEED)?,
                    tilt_limit: tilt.to_radians(),
                    periods: (secs * control_rate_hz).round().max(1.0) as u32,
                }
            }
            Self::Hold { radius_m, speed_limit_m_per_s, periods } => {
                let field = field.at("hold");
                Termination::Hold {
                    radius_m: field.at("radius_m").number(*radius_m, &LENGTH)?,
                    speed_limit: field.at("speed_limit_m_per_s").number(*speed_limit_m_per_s, &SPEED)?,
                    periods: field.at("periods").whole(*periods, 1..=100_000)? as u32,
                }
            }
            _ => Termination::Landing,
        })
    }
}

/// As published the station is the place of a drone on a box whose middle is given.
fn station(given: Vector3<f64>, as_published: bool) -> Vector3<f64> {
    if as_published { Vector3::new(given.x, given.y, 2.0 * given.z + 0.01347) } else { given }
}

fn check_bounds(bounds: &BoxConfig, aviary: &Aviary, field: &Field<'_>) -> Result<Termination, ConfigError> {
    let bounds = bounds.check(field)?;
    if !contains(&bounds, &aviary.goal) {
        return Err(field.reject("bounds without the goal", "bounds with `goal_m` inside"));
    }
    Ok(Termination::OutOfBounds(bounds))
}

impl SuccessConfig {
    /// What counts as success in episodes of `episode_secs` with these terminations.
    ///
    /// # Errors
    /// When a number is out of range, the time is longer than the episode, the region lacks the goal, or nothing can
    /// be a success.
    pub fn check(
        &self,
        aviary: &Aviary,
        episode_secs: f64,
        terminations: &[EndRule],
        field: &Field<'_>,
    ) -> Result<Success, ConfigError> {
        Ok(match self {
            Self::Settle { radius_m, within_secs } => {
                let field = field.at("settle");
                let time = Limits::above(0.0, episode_secs, "s, the episode");
                Success::Settle {
                    radius_m: field.at("radius_m").number(*radius_m, &LENGTH)?,
                    within_secs: field.at("within_secs").number(*within_secs, &time)?,
                }
            }
            Self::Reach { region, speed_limit_m_per_s } => {
                let field = field.at("reach");
                let checked = region.check(&field.at("region"))?;
                if !contains(&checked, &aviary.goal) {
                    return Err(field
                        .at("region")
                        .reject("a region without the goal", "one with `goal_m` inside"));
                }
                Success::Reach {
                    region: checked,
                    speed_limit: field.at("speed_limit_m_per_s").number(*speed_limit_m_per_s, &SPEED)?,
                }
            }
            Self::Visit { region, periods } => {
                let field = field.at("visit");
                Success::Visit {
                    region: region.check(&field.at("region"))?,
                    periods: field.at("periods").whole(*periods, 1..=100_000)? as u32,
                }
            }
            Self::Ending => {
                if !terminations.iter().any(|rule| rule.rule.is_success()) {
                    let expected = "a termination that is a success, such as `landing`";
                    return Err(field.reject("`ending` without one", expected));
                }
                Success::Ending
            }
        })
    }
}
