//! What is around the vehicle.

use mavlink::dialects::common::{DISTANCE_SENSOR_DATA, MavDistanceSensor, MavSensorOrientation};

use crate::frame::Payload;
use crate::plant::Ranges;

/// A ranger sees so far, and nothing nearer \[cm\].
const FARTHEST_CM: u16 = 400;
const NEAREST_CM: u16 = 2;

/// The accuracy is not known.
const UNKNOWN: u8 = u8::MAX;

/// `DISTANCE_SENSOR` of each ranger; where nothing is near, a distance beyond its range.
pub fn distance_sensors(ranges: &Ranges, time_boot_ms: u32) -> [Payload; 6] {
    let Ranges { front, back, left, right, up, down } = *ranges;
    let sensors = [
        (front, MavSensorOrientation::MAV_SENSOR_ROTATION_NONE),
        (back, MavSensorOrientation::MAV_SENSOR_ROTATION_YAW_180),
        (left, MavSensorOrientation::MAV_SENSOR_ROTATION_YAW_270),
        (right, MavSensorOrientation::MAV_SENSOR_ROTATION_YAW_90),
        (up, MavSensorOrientation::MAV_SENSOR_ROTATION_PITCH_90),
        (down, MavSensorOrientation::MAV_SENSOR_ROTATION_PITCH_270),
    ];
    let mut id = 0;
    sensors.map(|(distance_m, orientation)| {
        id += 1;
        Payload::of(&DISTANCE_SENSOR_DATA {
            time_boot_ms,
            min_distance: NEAREST_CM,
            max_distance: FARTHEST_CM,
            current_distance: distance_m.map_or(FARTHEST_CM + 1, |metres| libm::roundf(100.0 * metres) as u16),
            mavtype: MavDistanceSensor::MAV_DISTANCE_SENSOR_LASER,
            id,
            orientation,
            covariance: UNKNOWN,
        })
    })
}
