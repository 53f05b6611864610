//! What is around the vehicle.

use mavlink::dialects::common::MavSensorOrientation;

use crate::frame::Payload;
use crate::plant::Ranges;

/// A ranger sees so far, and nothing nearer \[cm\].
const FARTHEST_CM: u16 = 400;
const NEAREST_CM: u16 = 2;

/// The accuracy is not known.
const UNKNOWN: u8 = u8::MAX;

/// Sectors of `OBSTACLE_DISTANCE`, each of so many degrees.
const SECTORS: usize = 72;
const SECTOR_DEG: u8 = 5;

/// `MAV_DISTANCE_SENSOR_LASER` and `MAV_FRAME_BODY_FRD`.
const LASER: u8 = 0;
const BODY_FRD: u8 = 12;

/// What a ranger sees, from side to side: 27°, as the `VL53L1` of a Multi-ranger deck.
const VIEW_RAD: f32 = 0.471;

/// The same, in sectors to each side.
const SECTORS_ASIDE: usize = 2;

/// `OBSTACLE_DISTANCE` clockwise from the nose: what no ranger sees is not known.
pub fn obstacle_distance(ranges: &Ranges, time_usec: u64) -> Payload {
    let mut distances = [u16::MAX; SECTORS];
    let quarters = [ranges.front, ranges.right, ranges.back, ranges.left];
    for (quarter, distance_m) in quarters.into_iter().enumerate() {
        let ahead = quarter * SECTORS / 4 + SECTORS;
        for sector in ahead - SECTORS_ASIDE..=ahead + SECTORS_ASIDE {
            distances[sector % SECTORS] = centimetres(distance_m);
        }
    }
    let numbers = distances.into_iter().chain([NEAREST_CM, FARTHEST_CM]).flat_map(u16::to_le_bytes);
    // What the `mavlink` crate leaves out: the width and the first sector's angle as floats, and that they count from the nose.
    let extensions = [f32::from(SECTOR_DEG), 0.0].into_iter().flat_map(f32::to_le_bytes).chain([BODY_FRD]);
    let fields = time_usec.to_le_bytes().into_iter().chain(numbers).chain([LASER, SECTOR_DEG]).chain(extensions);
    Payload::new(330, 23, &fields.collect::<heapless::Vec<u8, 167>>())
}

/// Where nothing is near, a distance beyond the range.
fn centimetres(distance_m: Option<f32>) -> u16 {
    distance_m.map_or(FARTHEST_CM + 1, |metres| libm::roundf(100.0 * metres) as u16)
}

/// `DISTANCE_SENSOR` of each ranger.
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
        let shorts = [NEAREST_CM, FARTHEST_CM, centimetres(distance_m)].into_iter().flat_map(u16::to_le_bytes);
        let bytes = [LASER, id, orientation as u8, UNKNOWN];
        // What the `mavlink` crate leaves out: how wide and how high it sees.
        let views = [VIEW_RAD; 2].into_iter().flat_map(f32::to_le_bytes);
        let fields = time_boot_ms.to_le_bytes().into_iter().chain(shorts).chain(bytes).chain(views);
        Payload::new(132, 85, &fields.collect::<heapless::Vec<u8, 22>>())
    })
}
