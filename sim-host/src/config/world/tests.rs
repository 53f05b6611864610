use nalgebra::Vector3;

use crate::config::{AviaryConfig, AviaryParts, ConfigError, Document};
use crate::world::{BOX_CONTACT_GAP, Cuboid, Drive, Floor, Role, Shape, Solid};

fn place(text: &str) -> Result<AviaryParts, ConfigError> {
    let document = Document::parse("world.yaml", text)?;
    document.decode::<AviaryConfig>()?.place(&document.root())
}

fn solid(text: &str) -> Solid {
    place(&format!("solids: [{{{text}}}]")).unwrap().world.solids.remove(0)
}

/// The first line of the message, without the place.
fn refusal(text: &str) -> String {
    let message = place(text).unwrap_err().to_string();
    let line = message.lines().next().unwrap();
    line.split_once(": ").unwrap().1.to_owned()
}

#[track_caller]
fn assert_extent(solid: &Solid, low: [f64; 3], high: [f64; 3]) {
    let (found_low, found_high) = solid.extent();
    let worst = (found_low - Vector3::from(low)).amax().max((found_high - Vector3::from(high)).amax());
    assert!(worst < 1e-9, "{} is {found_low:?} to {found_high:?}", solid.name);
}

#[test]
fn every_outline_is_where_it_is_written() {
    assert_extent(&solid("low_m: [0, 1, 2], high_m: [1, 3, 5]"), [0.0, 1.0, 2.0], [1.0, 3.0, 5.0]);
    let turned = solid("box: {center_m: [0, 0, 1], size_m: [4, 2, 1], rpy_deg: [0, 0, 90]}");
    assert_extent(&turned, [-1.0, -2.0, 0.5], [1.0, 2.0, 1.5]);
    let lying = solid("cylinder: {center_m: [0, 0, 1], radius_m: 0.5, height_m: 4, rpy_deg: [90, 0, 0]}");
    assert_extent(&lying, [-0.5, -2.0, 0.5], [0.5, 2.0, 1.5]);
    let cone = solid("cone: {base_m: [1, 0, 1], height_m: 2, base_radius_m: 0.5, top_radius_m: 0.25}");
    assert_extent(&cone, [0.5, -0.5, 1.0], [1.5, 0.5, 3.0]);
    let hull = solid("hull: {points_m: [[0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3]]}");
    assert_extent(&hull, [0.0; 3], [1.0, 2.0, 3.0]);
}

#[test]
fn angles_turn_about_x_then_y_then_z() {
    let turned = solid("box: {center_m: [0, 0, 0], size_m: [6, 4, 2], rpy_deg: [90, 90, 90]}");
    // Bullet's getMatrixFromQuaternion(getQuaternionFromEuler([π/2, π/2, π/2])) has the rows 0 0 1, 0 1 0, -1 0 0.
    assert_extent(&turned, [-1.0, -2.0, -3.0], [1.0, 2.0, 3.0]);
    let rows = turned.pose.world_from_body.rows();
    let expected = [[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]];
    for (row, expected) in rows.iter().flatten().zip(expected.iter().flatten()) {
        assert!((row - expected).abs() < 1e-12, "{rows:?}");
    }
}

#[test]
fn surfaces_are_what_is_written_or_the_default() {
    let plain = solid("low_m: [0, 0, 0], high_m: [1, 1, 1]");
    assert_eq!((plain.role, plain.friction, plain.contact_gap), (Role::Obstacle, 0.5, BOX_CONTACT_GAP));
    let pad = solid(
        "low_m: [0, 0, 0], high_m: [1, 1, 1], name: pad, role: landing, friction: 1, contact_gap_m: 1.98e-3, colour: [1, 0.5, 0]",
    );
    assert_eq!((pad.name.as_str(), pad.role), ("pad", Role::Landing));
    assert_eq!((pad.friction, pad.contact_gap, pad.colour), (1.0, 1.98e-3, [1.0, 0.5, 0.0]));
}

#[test]
fn furniture_is_scaled_turned_and_moved() {
    let text = "
furniture:
  - name: shelf
    role: landing
    parts:
      - {name: board, low_m: [0, 0, 1], high_m: [2, 1, 2], role: decoration}
      - {cylinder: {center_m: [1, 0, 0], radius_m: 0.1, height_m: 1}}
    at_m: [10, 0, 0]
    yaw_deg: 90
    scale: 0.5
";
    let solids = place(text).unwrap().world.solids;
    assert_eq!((solids[0].name.as_str(), solids[1].name.as_str()), ("shelf: board", "shelf"));
    assert_eq!((solids[0].role, solids[1].role), (Role::Decoration, Role::Landing));
    assert_extent(&solids[0], [9.5, 0.0, 0.5], [10.0, 1.0, 1.0]);
    assert_extent(&solids[1], [9.95, 0.45, -0.25], [10.05, 0.55, 0.25]);
}

/// What is seen of a solid, as one that could be touched.
fn look(solid: &Solid) -> Solid {
    let (shape, pose) = solid.seen();
    Solid { shape: shape.clone(), pose, ..solid.clone() }
}

#[test]
fn a_look_is_where_it_is_written_however_its_body_is_turned() {
    let plain = solid("low_m: [0, 0, 0], high_m: [1, 1, 1]");
    assert_eq!((&plain.visual, plain.seen()), (&None, (&plain.shape, plain.pose)));
    let body = "box: {center_m: [3, 2, 1], size_m: [1, 2, 3], rpy_deg: [20, 40, 60]}";
    let both = |look: &str| solid(&format!("{body}, look: {{{look}}}"));
    let written = both("low_m: [0, 1, 2], high_m: [1, 3, 5]");
    let touched = solid(body);
    assert_eq!((&written.shape, written.pose, written.extent()), (&touched.shape, touched.pose, touched.extent()));
    assert_extent(&look(&written), [0.0, 1.0, 2.0], [1.0, 3.0, 5.0]);
    let lying = "cylinder: {center_m: [0, 0, 1], radius_m: 0.5, height_m: 4, rpy_deg: [90, 0, 0]}";
    assert_extent(&look(&both(lying)), [-0.5, -2.0, 0.5], [0.5, 2.0, 1.5]);
    let cushion = "superellipsoid: {low_m: [0, 0, 0], high_m: [2, 1, 1], exponents: [8, 4, 2]}";
    assert_extent(&look(&both(cushion)), [0.0; 3], [2.0, 1.0, 1.0]);
    let parts = r#"mesh: {obj: "o a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\no b\nv 0 0 2\nf 1 2 4\n"}"#;
    let mesh = both(parts);
    let Shape::Mesh(triangles) = mesh.seen().0 else { panic!("a mesh") };
    assert_eq!(triangles.triangles.len(), 2, "both parts");
    assert_extent(&look(&mesh), [0.0; 3], [1.0, 1.0, 2.0]);
}

#[test]
fn looks_of_furniture_are_scaled_turned_and_moved_with_it() {
    let text = "
at_m: [0, 0, 3]
furniture:
  - name: lamp
    parts:
      - low_m: [0, 0, 1]
        high_m: [2, 1, 2]
        look: {box: {center_m: [3, 0, 1], size_m: [2, 4, 1], rpy_deg: [0, 0, 90]}}
      - {mesh: {obj: \"v 0 0 0\\nv 1 0 0\\nv 0 1 0\\nv 0 0 1\\nf 1 3 2\\nf 1 2 4\\n\", rpy_deg: [0, 0, 90]}, look: {sphere: {center_m: [1, 2, 3], radius_m: 1}}}
    at_m: [10, 0, 0]
    yaw_deg: 90
    scale: 0.5
";
    let solids = place(text).unwrap().world.solids;
    assert_extent(&solids[0], [9.5, 0.0, 3.5], [10.0, 1.0, 4.0]);
    // In its own frame it is from (1, -1, 0.5) to (5, 1, 1.5).
    assert_extent(&look(&solids[0]), [9.5, 0.5, 3.25], [10.5, 2.5, 3.75]);
    assert_extent(&solids[1], [9.5, -0.5, 3.0], [10.0, 0.0, 3.5]);
    assert_extent(&look(&solids[1]), [8.5, 0.0, 4.0], [9.5, 1.0, 5.0]);
}

#[test]
fn wrong_looks_get_their_messages() {
    let box_with =
        |look: &str| refusal(&format!("solids: [{{low_m: [0, 0, 0], high_m: [1, 1, 1], look: {look}}}]"));
    let forms =
        "one of `low_m` with `high_m`, `box`, `cylinder`, `sphere`, `cone`, `superellipsoid`, `hull` or `mesh`";
    assert_eq!(box_with("{}"), format!("solids.0.look: found no outline, expected {forms}"));
    assert_eq!(
        box_with("{low_m: [0, 0, 0], high_m: [1, 1, 1], sphere: {center_m: [0, 0, 0], radius_m: 1}}"),
        format!("solids.0.look: found 2 outlines, expected {forms}")
    );
    assert_eq!(
        box_with("{sphere: {center_m: [1, 2, 3], radius_m: 0}}"),
        "solids.0.look.sphere.radius_m: found 0, expected a number above 0, at most 1000 m"
    );
    assert_eq!(
        box_with("{high_m: [0, 0, 0]}"),
        "solids.0.look: found no key `low_m`, expected one beside `high_m`"
    );
    assert_eq!(
        box_with("{role: landing}"),
        "solids.0.look: found the unknown key `role`, expected `low_m`, `high_m`, `box`, `cylinder`, `sphere`, `cone`, `superellipsoid`, `hull` or `mesh` (did you mean `cone`?)"
    );
    let alone = "solids: [{look: {sphere: {center_m: [1, 2, 3], radius_m: 1}}}]";
    assert_eq!(refusal(alone), format!("solids.0: found no outline, expected {forms}"));
    let parts = r#"{obj: "o a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\no b\nv 0 0 2\nf 1 2 4\n"}"#;
    assert_eq!(
        refusal(&format!("solids: [{{mesh: {parts}, look: {{low_m: [0, 0, 0], high_m: [1, 1, 1]}}}}]")),
        "solids.0.look: found a look of 2 bodies, the parts of `mesh`, expected one body that has it"
    );
    assert_eq!(
        box_with(r#"{mesh: {obj: "v 0 0 0\nf 1 2 3\n"}}"#),
        "solids.0.look.mesh.obj: found `2` in line 2, expected one of the 1 corners (`v`) above"
    );
}

#[test]
fn a_pillar_leans_as_in_the_reference() {
    let pillar = place("pillars: [[2, 0.5]]").unwrap().world.solids.remove(0);
    let lean = std::f64::consts::FRAC_PI_2 - 1.57057;
    let (wide, high) = (0.09 * lean.cos() + 0.5 * lean.sin(), 0.5 * lean.cos() + 0.09 * lean.sin());
    assert_extent(&pillar, [2.0 - wide, 0.41, 0.5 - high], [2.0 + wide, 0.59, 0.5 + high]);
    assert!((wide - 0.09 - 1.13e-4).abs() < 1e-6, "fact sheet: 1.1e-4 beyond 0.09");
    assert_eq!((pillar.shape, pillar.friction), (Shape::Cuboid(Vector3::new(0.5, 0.09, 0.09)), 1.0));
}

#[test]
fn worlds_set_into_a_world_bring_their_goals_unless_it_has_one() {
    let text = "
worlds:
  - {goal_m: [1, 0, 1], starts_m: [[0, 0, 1]], pillars: [[2, 0]]}
  - {goal_m: [1, 0, 1], starts_m: [[0, 0, 1]], pillars: [[2, 0]], at_m: [0, 2.5, 0]}
";
    let found = place(text).unwrap();
    assert_eq!(found.goals, [Vector3::new(1.0, 0.0, 1.0), Vector3::new(1.0, 2.5, 1.0)]);
    assert_eq!(found.starts[1], Vector3::new(0.0, 2.5, 1.0));
    assert_eq!(found.world.solids[1].pose.position, Vector3::new(2.0, 2.5, 0.5));
    assert_eq!(found.world.floor, Floor::Solid);
    let own = place(&format!("goal_m: [5, 5, 1]{text}")).unwrap();
    assert_eq!(own.goals, [Vector3::new(5.0, 5.0, 1.0)]);
}

#[test]
fn walls_are_exact() {
    let room = place("room: {low_m: [-1, -1, 0], high_m: [5, 1, 1], wall_m: 0.2, colour: [1, 0.4, 0.4]}").unwrap();
    let [back, front, right, left] = <[Solid; 4]>::try_from(room.world.solids).unwrap();
    assert_extent(&back, [-1.2, -1.2, 0.0], [-1.0, 1.2, 1.0]);
    assert_extent(&front, [5.0, -1.2, 0.0], [5.2, 1.2, 1.0]);
    assert_extent(&right, [-1.0, -1.2, 0.0], [5.0, -1.0, 1.0]);
    assert_extent(&left, [-1.0, 1.0, 0.0], [5.0, 1.2, 1.0]);
    assert_eq!(left.bounds(), Cuboid { low: [-1.0, 1.0, 0.0].into(), high: [5.0, 1.2, 1.0].into() });
    assert_eq!(left.colour, [1.0, 0.4, 0.4]);
}

#[test]
fn a_sphere_is_as_wide_as_it_is_high() {
    let ball = place("solids: [{sphere: {center_m: [1, 2, 3], radius_m: 0.5}}]").unwrap().world.solids.remove(0);
    assert_extent(&ball, [0.5, 1.5, 2.5], [1.5, 2.5, 3.5]);
    assert_eq!(
        refusal("solids: [{sphere: {center_m: [1, 2, 3], radius_m: 0}}]"),
        "solids.0.sphere.radius_m: found 0, expected a number above 0, at most 1000 m"
    );
}

#[test]
fn a_superellipsoid_fills_its_box() {
    let cushion = solid(
        "superellipsoid: {low_m: [0, 0, 0], high_m: [2, 1, 1], middle_m: [1, 0.5, 0.25], exponents: [8, 4, 2]}",
    );
    assert_extent(&cushion, [0.0, 0.0, 0.0], [2.0, 1.0, 1.0]);
    let Shape::Hull(points) = &cushion.shape else { panic!("a hull") };
    assert_eq!(points.len(), 98);
    for point in points {
        let [x, y, z] = (point + cushion.pose.position - Vector3::new(1.0, 0.5, 0.25)).into();
        let z = if z > 0.0 { z / 0.75 } else { z / 0.25 };
        let sum = x.powi(8) + (y / 0.5).powi(4) + z.powi(2);
        assert!((sum - 1.0).abs() < 1e-9, "{sum} at {point}");
    }
    assert_eq!(
        refusal("solids: [{superellipsoid: {low_m: [0, 0, 0], high_m: [1, 1, 1], exponents: [2, 0.5, 2]}}]"),
        "solids.0.superellipsoid.exponents.1: found 0.5, expected a number from 1 to 100"
    );
    assert_eq!(
        refusal(
            "solids: [{superellipsoid: {low_m: [0, 0, 0], high_m: [1, 1, 1], middle_m: [0.5, 0.5, 1], exponents: [2, 2, 2]}}]"
        ),
        "solids.0.superellipsoid.middle_m.2: found 1, expected a number between 0 and 1, inside of the box"
    );
}

#[test]
fn movables_have_a_mass_and_one_outline() {
    let movable = place(
        "movables: [{name: cube, box: {center_m: [0, 0, 0.025], size_m: [0.05, 0.05, 0.05]}, mass_kg: 0.1}]",
    )
    .unwrap()
    .world
    .movables
    .remove(0);
    assert_eq!(movable.drive, Drive::Pushed { mass: 0.1 });
    assert_eq!(movable.solid.name, "cube");
    assert_extent(&movable.solid, [-0.025, -0.025, 0.0], [0.025, 0.025, 0.05]);
    assert_eq!(refusal("movables: [{mass_kg: 1}]"), "movables.0: found no outline, expected `box` or `cylinder`");
    assert_eq!(
        refusal("movables: [{box: {center_m: [0, 0, 0], size_m: [1, 1, 1]}, mass_kg: 0}]"),
        "movables.0.mass_kg: found 0, expected a number from 0.0001 to 1000000 kg"
    );
}

#[test]
fn wrong_solids_get_their_messages() {
    let forms =
        "one of `low_m` with `high_m`, `box`, `cylinder`, `sphere`, `cone`, `superellipsoid`, `hull` or `mesh`";
    assert_eq!(refusal("solids: [{name: x}]"), format!("solids.0: found no outline, expected {forms}"));
    assert_eq!(
        refusal("solids: [{low_m: [0, 0, 0], cylinder: {center_m: [0, 0, 0], radius_m: 1, height_m: 1}}]"),
        format!("solids.0: found 2 outlines, expected {forms}")
    );
    assert_eq!(
        refusal("solids: [{low_m: [0, 0, 0]}]"),
        "solids.0: found no key `high_m`, expected one beside `low_m`"
    );
    assert_eq!(
        refusal("solids: [{box: {center_m: [0, 0, 0], size_m: [1, 0, 1]}}]"),
        "solids.0.box.size_m.1: found 0, expected a number above 0, at most 1000 m"
    );
    assert_eq!(
        refusal("solids: [{hull: {points_m: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0], [2, 3, 0]]}}]"),
        "solids.0.hull.points_m: found points in one plane, expected 4 to 256 points, not all in one plane"
    );
    assert_eq!(
        refusal("solids: [{hull: {points_m: [[0, 0, 0]]}}]"),
        "solids.0.hull.points_m: found a list of 1, expected 4 to 256 points, not all in one plane"
    );
    assert_eq!(
        refusal("furniture: [{name: x, parts: [{low_m: [0, 0, 0], high_m: [1, 1, 0]}]}]"),
        "furniture.0.parts.0.high_m.2: found 0, expected more than 0, the z of `low_m`"
    );
    assert_eq!(
        refusal("solids: [{low_m: [0, 0, 0], high_m: [1, 1, 1], colour: [0, 2, 0]}]"),
        "solids.0.colour.1: found 2, expected a number from 0 to 1"
    );
    assert_eq!(refusal("pillars: [[0, .nan]]"), "pillars.0.1: found .nan, expected a number from -1000 to 1000 m");
    let many = vec!["[0, 0]"; 1025].join(", ");
    assert_eq!(refusal(&format!("pillars: [{many}]")), "found 1025 solids, expected at most 1024");
}

#[test]
fn a_goal_inside_any_outline_is_refused() {
    let around = |outline: &str, goal: &str| place(&format!("goal_m: {goal}\nsolids: [{{{outline}}}]")).is_err();
    let cylinder = "cylinder: {center_m: [0, 0, 1], radius_m: 0.5, height_m: 2}";
    assert!(around(cylinder, "[0.3, 0.3, 1]") && !around(cylinder, "[0.4, 0.4, 1]"));
    let turned = "box: {center_m: [0, 0, 1], size_m: [2, 0.1, 1], rpy_deg: [0, 0, 45]}";
    assert!(around(turned, "[0.5, 0.5, 1]") && !around(turned, "[0.5, -0.5, 1]"));
    let hull = "hull: {points_m: [[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]]}";
    assert!(around(hull, "[0.2, 0.2, 0.2]") && !around(hull, "[0.4, 0.4, 0.4]"));
}
