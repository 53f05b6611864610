use kestrel_onboard::fence::{Cylinder, Fence};
use nalgebra::Vector3;
use proptest::prelude::*;

use super::*;

const INVALID: MavMissionResult = MavMissionResult::MAV_MISSION_INVALID;

fn item(command: u16, first: f32, group: f32, [east, north]: [f64; 2]) -> MissionItem {
    MissionItem {
        frame: 1,
        command,
        autocontinue: 1,
        parameters: [first, group, f32::NAN, f32::NAN],
        place: [(north * 1e4).round() as i32, (east * 1e4).round() as i32],
        height: 0.0,
    }
}

fn polygon(command: u16, group: f32, corners: &[[f64; 2]]) -> Vec<MissionItem> {
    corners.iter().map(|corner| item(command, corners.len() as f32, group, *corner)).collect()
}

fn zones(items: &[MissionItem]) -> Result<Zones, MavMissionResult> {
    super::zones(items, &Home::default())
}

fn fence(items: &[MissionItem]) -> Fence {
    Fence { zones: zones(items).unwrap(), cylinder: Cylinder::default() }
}

fn square(half_m: f64) -> [[f64; 2]; 4] {
    [[-half_m, -half_m], [half_m, -half_m], [half_m, half_m], [-half_m, half_m]]
}

fn at(x: f32, y: f32) -> Vector3<f32> {
    Vector3::new(x, y, 1.0)
}

#[test]
fn a_hole_in_a_zone_is_a_zone_to_stay_out_of() {
    let items = [polygon(5001, 0.0, &square(10.0)), polygon(5002, 0.0, &square(2.0))].concat();
    let fence = fence(&items);
    assert!(fence.contains(&at(5.0, 0.0)));
    assert!(!fence.contains(&at(0.0, 0.0)) && !fence.contains(&at(11.0, 0.0)));
    assert!((fence.margin_m(&at(5.0, 0.0)) - 3.0).abs() < 1e-5);
}

#[test]
fn pathological_polygons_are_refused() {
    let bow_tie = [[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]];
    let flat = [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]];
    let point = [[1.0, 1.0]; 3];
    let repeated = [[0.0, 0.0], [0.0, 0.0], [1.0, 0.0], [1.0, 1.0]];
    let closed = [[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 0.0]];
    let spike = [[0.0, 0.0], [2.0, 0.0], [1.0, 0.0], [1.0, 1.0]];
    let touching = [[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [2.0, 0.0], [0.0, 2.0]];
    let pinched = [[0.0, 0.0], [2.0, 0.0], [1.0, 1.0], [2.0, 2.0], [0.0, 2.0], [1.0, 1.0]];
    let cases: [&[[f64; 2]]; 8] = [&bow_tie, &flat, &point, &repeated, &closed, &spike, &touching, &pinched];
    for corners in cases {
        assert_eq!(zones(&polygon(5001, 0.0, corners)), Err(INVALID), "{corners:?}");
    }
    let straight = [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [2.0, 2.0]];
    assert!(zones(&polygon(5001, 0.0, &straight)).is_ok(), "a corner of 180 degrees is harmless");
}

#[test]
fn items_that_make_no_fence_are_refused_by_their_parameter() {
    use MavMissionResult::{
        MAV_MISSION_INVALID_PARAM1, MAV_MISSION_INVALID_PARAM2, MAV_MISSION_INVALID_PARAM5_X,
        MAV_MISSION_UNSUPPORTED,
    };
    let whole = polygon(5001, 0.0, &square(1.0));
    assert_eq!(zones(&whole[..3]), Err(MAV_MISSION_INVALID_PARAM1), "cut short");
    let mut mixed = whole.clone();
    mixed[2].command = 5002;
    assert_eq!(zones(&mixed), Err(MAV_MISSION_INVALID_PARAM1));
    let mut counted = whole.clone();
    counted[3].parameters[0] = 3.0;
    assert_eq!(zones(&counted), Err(MAV_MISSION_INVALID_PARAM1));
    let mut grouped = whole.clone();
    grouped[1].parameters[1] = 1.0;
    assert_eq!(zones(&grouped), Err(MAV_MISSION_INVALID_PARAM2));
    let alone = |command, first, group| check(&item(command, first, group, [0.0; 2]), &Home::default());
    for corners in [0.0, 2.0, 3.5, 33.0, -3.0, f32::NAN, f32::INFINITY] {
        assert_eq!(alone(5001, corners, 0.0), Err(MAV_MISSION_INVALID_PARAM1), "{corners}");
    }
    for radius_m in [0.0, -1.0, 1e6, f32::NAN, f32::INFINITY] {
        assert_eq!(alone(5003, radius_m, 0.0), Err(MAV_MISSION_INVALID_PARAM1), "{radius_m}");
    }
    for group in [-1.0, 0.5, 256.0, f32::INFINITY] {
        assert_eq!(alone(5003, 1.0, group), Err(MAV_MISSION_INVALID_PARAM2), "{group}");
    }
    assert_eq!(alone(16, 0.0, 0.0), Err(MAV_MISSION_UNSUPPORTED));
    let nowhere = MissionItem { place: [super::super::OPEN; 2], ..item(5003, 1.0, 0.0, [0.0; 2]) };
    assert_eq!(check(&nowhere, &Home::default()), Err(MAV_MISSION_INVALID_PARAM5_X));
    assert_eq!(alone(5000, 0.0, 0.0), Ok(()), "a return point is kept");
    assert_eq!(zones(&[item(5000, 0.0, 0.0, [0.0; 2])]).map(|zones| zones.is_empty()), Ok(true));
}

proptest! {
    #[test]
    fn no_items_panic(
        items in proptest::collection::vec(
            (4999_u16..5006, -2.0_f32..6.0, -1.0_f32..3.0, [-3.0_f64..3.0, -3.0_f64..3.0]), 0..32
        ),
        x in any::<f32>(), y in any::<f32>()
    ) {
        let items: Vec<MissionItem> = items
            .into_iter()
            .map(|(command, first, group, place)| item(command, first.round(), group.round(), place))
            .collect();
        if let Ok(zones) = zones(&items) {
            let fence = Fence { zones, cylinder: Cylinder::default() };
            prop_assert_eq!(fence.contains(&at(x, y)), fence.margin_m(&at(x, y)) >= 0.0);
        }
    }
}
