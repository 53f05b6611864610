use proptest::prelude::*;

use super::*;

const INSIDE: ZoneKind = ZoneKind::Inside { group: 0 };

fn fence(zones: Zones) -> Fence {
    Fence { zones, cylinder: Cylinder::default() }
}

fn polygon(corners: &[[f64; 2]], kind: ZoneKind) -> Result<Zones, ZoneError> {
    let corners: Vec<_> = corners.iter().copied().map(Vector2::from).collect();
    let mut zones = Zones::default();
    zones.add_polygon(&corners, kind).map(|()| zones)
}

fn circles(circles: &[([f64; 2], f64, ZoneKind)]) -> Fence {
    let mut zones = Zones::default();
    for (center, radius_m, kind) in circles {
        zones.add_circle((*center).into(), *radius_m, *kind).unwrap();
    }
    fence(zones)
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
    let inside = circles(&[([1.0, 2.0], 5.0, INSIDE)]);
    let outside = circles(&[([1.0, 2.0], 5.0, ZoneKind::Outside)]);
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
        let fence = fence(polygon(&corners, INSIDE).unwrap());
        assert!((fence.margin_m(&at(0.5, 0.5)) - 0.5).abs() < 1e-6);
        assert!((fence.margin_m(&at(1.5, 1.5)) + 0.5).abs() < 1e-6);
        assert!((fence.margin_m(&at(3.0, -1.0)) + 2.0_f32.sqrt()).abs() < 1e-6, "from a corner");
        assert!(!fence.contains(&at(1.5, 1.5)) && fence.contains(&at(0.5, 1.5)));
    }
}

#[test]
fn a_ray_through_a_corner_is_counted_once() {
    let diamond = fence(polygon(&[[0.0, -1.0], [1.0, 0.0], [0.0, 1.0], [-1.0, 0.0]], INSIDE).unwrap());
    assert!(diamond.contains(&at(0.0, 0.0)));
    assert!(!diamond.contains(&at(-2.0, 0.0)) && !diamond.contains(&at(2.0, 0.0)));
    assert!(!diamond.contains(&at(-2.0, 1.0)) && !diamond.contains(&at(-2.0, -1.0)));
}

#[test]
fn zones_of_a_group_all_hold_and_of_groups_one_suffices() {
    let circle = |group, east| ([east, 0.0], 2.0, ZoneKind::Inside { group });
    let both = circles(&[circle(0, 0.0), circle(0, 3.0)]);
    assert!(both.contains(&at(1.5, 0.0)) && !both.contains(&at(0.0, 0.0)) && !both.contains(&at(3.0, 0.0)));
    let either = circles(&[circle(0, 0.0), circle(1, 3.0)]);
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
fn what_is_no_zone_is_refused_and_leaves_nothing() {
    let refused = |corners: &[[f64; 2]]| polygon(corners, INSIDE).map(|_| ()).unwrap_err();
    assert_eq!(refused(&[[0.0, 0.0], [1.0, 0.0]]), ZoneError::NotSimple);
    assert_eq!(refused(&[[0.0, 0.0], [1.0, 1.0], [1.0, 0.0], [0.0, 1.0]]), ZoneError::NotSimple, "a bow tie");
    assert_eq!(refused(&[[0.0, 0.0], [1.0, 0.0], [f64::NAN, 1.0]]), ZoneError::NotFinite);
    let many: Vec<[f64; 2]> =
        (0..33).map(|i| f64::from(i) * 0.1).map(|angle| [angle.cos(), angle.sin()]).collect();
    assert_eq!(refused(&many), ZoneError::NoSpace);
    let mut zones = Zones::default();
    for radius_m in [0.0, -1.0, f64::NAN, f64::INFINITY] {
        assert_eq!(zones.add_circle(Vector2::zeros(), radius_m, INSIDE), Err(ZoneError::NotFinite));
    }
    assert!(zones.is_empty());
    for _ in 0..ZONES {
        zones.add_circle(Vector2::zeros(), 1.0, INSIDE).unwrap();
    }
    assert_eq!(zones.add_circle(Vector2::zeros(), 1.0, INSIDE), Err(ZoneError::NoSpace));
}

/// The polygon from each of its corners, in both directions: what it is does not depend on where it begins.
fn from_every_corner(corners: &[[f64; 2]]) -> impl Iterator<Item = Vec<[f64; 2]>> {
    let forward = corners.to_vec();
    let backward: Vec<_> = corners.iter().rev().copied().collect();
    (0..corners.len()).flat_map(move |start| {
        [&forward, &backward].map(|corners| {
            let mut turned = corners.clone();
            turned.rotate_left(start);
            turned
        })
    })
}

#[test]
fn a_corner_that_touches_an_edge_makes_no_zone() {
    // Squares from 0 to 4 with a notch from above or with a spike to the right, whose tip comes as far as its last number.
    let notch = |tip_y| [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [3.0, 4.0], [2.0, tip_y], [1.0, 4.0], [0.0, 4.0]];
    let spike = |tip_x| [[0.0, 0.0], [4.0, 0.0], [4.0, 4.0], [0.0, 4.0], [0.0, 3.0], [tip_x, 2.0], [0.0, 1.0]];
    for (reaches, touches) in [(notch(0.001), notch(0.0)), (spike(3.999), spike(4.0))] {
        for corners in from_every_corner(&reaches) {
            assert!(polygon(&corners, INSIDE).is_ok(), "{corners:?}");
        }
        for corners in from_every_corner(&touches) {
            assert_eq!(polygon(&corners, INSIDE).map(|_| ()), Err(ZoneError::NotSimple), "{corners:?}");
        }
    }
}

#[test]
fn corners_and_edges_that_lie_on_each_other_make_no_zone() {
    let cases: [&[[f64; 2]]; 4] = [
        // Two triangles that share a corner.
        &[[0.0, 0.0], [-1.0, 1.0], [-1.0, -1.0], [0.0, 0.0], [1.0, -1.0], [1.0, 1.0]],
        // A corridor without width, which runs back along a part of an edge.
        &[[0.0, 0.0], [4.0, 0.0], [4.0, 2.0], [3.0, 2.0], [3.0, 0.0], [1.0, 0.0], [1.0, 2.0], [0.0, 2.0]],
        // A corner that is there twice.
        &[[0.0, 0.0], [1.0, 0.0], [1.0, 0.0], [0.0, 1.0]],
        // A spike without width.
        &[[0.0, 0.0], [2.0, 0.0], [1.0, 0.0], [1.0, 1.0]],
    ];
    for corners in cases.iter().flat_map(|corners| from_every_corner(corners)) {
        assert_eq!(polygon(&corners, INSIDE).map(|_| ()), Err(ZoneError::NotSimple), "{corners:?}");
    }
}

proptest! {
    #[test]
    fn a_square_has_its_closed_form(x in -20.0_f32..20.0, y in -20.0_f32..20.0) {
        let fence = fence(polygon(&[[-10.0, -10.0], [10.0, -10.0], [10.0, 10.0], [-10.0, 10.0]], INSIDE).unwrap());
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
        let fence = fence(polygon(&corners, INSIDE).unwrap());
        // The sagitta of an edge: 10 (1 - cos(pi / 32)) = 0.048.
        let difference = (10.0 - x.hypot(y)) - fence.margin_m(&at(x, y));
        prop_assert!((-1e-3..0.0492).contains(&difference), "{difference}");
    }
}
