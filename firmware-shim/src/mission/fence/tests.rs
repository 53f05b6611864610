use proptest::prelude::*;

use super::*;

const INVALID: MavMissionResult = MavMissionResult::MAV_MISSION_INVALID;

fn item(command: u16, first: f32, group: f32, [east, north]: [f64; 2]) -> Item {
    Item {
        frame: 1,
        command,
        autocontinue: 1,
        parameters: [first, group, f32::NAN, f32::NAN],
        place: [(north * 1e4).round() as i32, (east * 1e4).round() as i32],
        height: 0.0,
    }
}

fn polygon(command: u16, group: f32, corners: &[[f64; 2]]) -> Vec<Item> {
    corners.iter().map(|corner| item(command, corners.len() as f32, group, *corner)).collect()
}

fn zones(items: &[Item]) -> Result<Zones, MavMissionResult> {
    Zones::of(items, &Home::default())
}

fn fence(items: &[Item]) -> Fence {
    Fence { zones: zones(items).unwrap(), cylinder: Cylinder::default() }
}

fn square(half_m: f64) -> [[f64; 2]; 4] {
    [[-half_m, -half_m], [half_m, -half_m], [half_m, half_m], [-half_m, half_m]]
}

fn at(x: f32, y: f32) -> Vector3<f32> {
    Vector3::new(x, y, 1.0)
}

#[test]
fn without_a_fence_everything_is_allowed_but_nonsense() {
    let fence = Fence::default();
    assert_eq!(fence.margin_m(&at(1e6, -1e6)), f32::INFINITY);
    assert!(!fence.contains(&at(f32::NAN, 0.0)));
    assert!(!fence.contains(&at(f32::INFINITY, 0.0)));
}

#[test]
fn a_circle_is_as_wide_as_its_radius() {
    let inside = fence(&[item(5003, 5.0, 0.0, [1.0, 2.0])]);
    let outside = fence(&[item(5004, 5.0, 0.0, [1.0, 2.0])]);
    for (x, y, expected) in [(1.0, 2.0, 5.0), (4.0, 6.0, 0.0), (7.0, 2.0, -1.0)] {
        assert!((inside.margin_m(&at(x, y)) - expected).abs() < 1e-5);
        assert!((outside.margin_m(&at(x, y)) + expected).abs() < 1e-5);
    }
}

#[test]
fn a_polygon_may_turn_inward() {
    // An L: the square from 0 to 2 without its north-east quarter.
    let corners = [[0.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0, 1.0], [1.0, 2.0], [0.0, 2.0]];
    for corners in [corners.to_vec(), corners.iter().rev().copied().collect()] {
        let fence = fence(&polygon(5001, 0.0, &corners));
        assert!((fence.margin_m(&at(0.5, 0.5)) - 0.5).abs() < 1e-6);
        assert!((fence.margin_m(&at(1.5, 1.5)) + 0.5).abs() < 1e-6);
        assert!((fence.margin_m(&at(3.0, -1.0)) + 2.0_f32.sqrt()).abs() < 1e-6, "from a corner");
        assert!(!fence.contains(&at(1.5, 1.5)) && fence.contains(&at(0.5, 1.5)));
    }
}

#[test]
fn a_ray_through_a_corner_is_counted_once() {
    let diamond = fence(&polygon(5001, 0.0, &[[0.0, -1.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]]));
    assert!(diamond.contains(&at(0.0, 0.0)));
    assert!(!diamond.contains(&at(-2.0, 0.0)) && !diamond.contains(&at(2.0, 0.0)));
    assert!(!diamond.contains(&at(-2.0, 1.0)) && !diamond.contains(&at(-2.0, -1.0)));
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
fn zones_of_a_group_all_hold_and_of_groups_one_suffices() {
    let circle = |group, east| item(5003, 2.0, group, [east, 0.0]);
    let both = fence(&[circle(0.0, 0.0), circle(0.0, 3.0)]);
    assert!(both.contains(&at(1.5, 0.0)) && !both.contains(&at(0.0, 0.0)) && !both.contains(&at(3.0, 0.0)));
    let either = fence(&[circle(0.0, 0.0), circle(1.0, 3.0)]);
    assert!(either.contains(&at(1.5, 0.0)) && either.contains(&at(0.0, 0.0)) && either.contains(&at(3.0, 0.0)));
    assert!(!either.contains(&at(5.1, 0.0)));
}

#[test]
fn the_cylinder_limits_distance_and_height() {
    let cylinder = Cylinder { center: Vector3::new(1.0, 0.0, 0.0), radius_m: Some(5.0), height_m: Some(3.0) };
    let fence = Fence { zones: Zones::default(), cylinder };
    assert!((fence.margin_m(&Vector3::new(4.0, 0.0, 0.0)) - 2.0).abs() < 1e-6);
    assert!((fence.margin_m(&Vector3::new(4.0, 4.0, 4.0)) + 1.0).abs() < 1e-6);
    assert!(!fence.contains(&Vector3::new(4.1, 4.0, 1.0)));
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
    let nowhere = Item { place: [super::super::OPEN; 2], ..item(5003, 1.0, 0.0, [0.0; 2]) };
    assert_eq!(check(&nowhere, &Home::default()), Err(MAV_MISSION_INVALID_PARAM5_X));
    assert_eq!(alone(5000, 0.0, 0.0), Ok(()), "a return point is kept");
    assert_eq!(zones(&[item(5000, 0.0, 0.0, [0.0; 2])]).map(|zones| zones.is_empty()), Ok(true));
}

proptest! {
    #[test]
    fn a_square_has_its_closed_form(x in -20.0_f32..20.0, y in -20.0_f32..20.0) {
        let fence = fence(&polygon(5001, 0.0, &square(10.0)));
        let [beyond_x, beyond_y] = [x.abs() - 10.0, y.abs() - 10.0];
        let expected = if beyond_x > 0.0 && beyond_y > 0.0 {
            -beyond_x.hypot(beyond_y)
        } else {
            -beyond_x.max(beyond_y)
        };
        prop_assert!((fence.margin_m(&at(x, y)) - expected).abs() < 1e-4);
    }

    #[test]
    fn a_polygon_of_many_corners_is_nearly_its_circle(
        x in -20.0_f32..20.0, y in -20.0_f32..20.0, first in 0.0_f64..1.0
    ) {
        let corner = |i: u8| {
            let angle = (f64::from(i) + first) * core::f64::consts::TAU / 32.0;
            [10.0 * angle.cos(), 10.0 * angle.sin()]
        };
        let corners: Vec<_> = (0..32).map(corner).collect();
        let fence = fence(&polygon(5001, 0.0, &corners));
        // The sagitta of an edge: 10 (1 - cos(pi / 32)) = 0.048.
        let difference = (10.0 - x.hypot(y)) - fence.margin_m(&at(x, y));
        prop_assert!((-1e-3..0.0492).contains(&difference), "{difference}");
    }

    #[test]
    fn no_items_panic(
        items in proptest::collection::vec(
            (4999_u16..5006, -2.0_f32..6.0, -1.0_f32..3.0, [-3.0_f64..3.0, -3.0_f64..3.0]), 0..32
        ),
        x in any::<f32>(), y in any::<f32>()
    ) {
        let items: Vec<Item> = items
            .into_iter()
            .map(|(command, first, group, place)| item(command, first.round(), group.round(), place))
            .collect();
        if let Ok(zones) = zones(&items) {
            let fence = Fence { zones, cylinder: Cylinder::default() };
            prop_assert_eq!(fence.contains(&at(x, y)), fence.margin_m(&at(x, y)) >= 0.0);
        }
    }
}
