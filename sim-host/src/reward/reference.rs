//! The reward components and tasks of the reference system, gym-pybullet-drones as the thesis changed it, each under its
//! class's name and by its formula, paid every control period as there.

pub(super) mod bounds;
pub(super) mod climb;
pub(super) mod collision;
pub(super) mod delta_distance;
pub(super) mod delta_distance_v2;
pub(super) mod distance_root;
pub(super) mod distance_root_v2;
pub(super) mod drop_altitude;
pub(super) mod enter_area;
pub(super) mod exit;
pub(super) mod field_coverage;
pub(super) mod height_difference;
pub(super) mod increase_x;
pub(super) mod increase_x_v2;
pub(super) mod land_vision;
pub(super) mod landing;
pub(super) mod landing_v2;
pub(super) mod meeting;
pub(super) mod no_collision;
pub(super) mod orientation;
pub(super) mod quartic_distance;
pub(super) mod rebase;
pub(super) mod safe_delta_distance;
pub(super) mod safe_distance;
pub(super) mod slowdown;
pub(super) mod speed;
pub(super) mod squared_distance;
pub(super) mod touch_landing_zone;
pub(super) mod waypoint;
