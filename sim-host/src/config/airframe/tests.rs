use std::path::PathBuf;

use kestrel_core::airframe::{
    Airframe, BOLT_5_INCH, CF2P, CF2X, CRAZYFLIE_2_1, CRAZYFLIE_2_1_BRUSHLESS, CRAZYFLIE_2_1_PLUS,
    CRAZYFLIE_2_1_THRUST_UPGRADE, HUMMINGBIRD, RACER, RotorOrder, X500,
};

use super::*;
use crate::config::VehicleConfig;

fn asset(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../assets/airframes").join(name)
}

fn shipped(name: &str) -> String {
    std::fs::read_to_string(asset(&format!("{name}.yaml"))).unwrap()
}

/// The airframe that `text` describes in a file called `name`.
fn airframe(name: &str, text: &str) -> Result<Airframe, ConfigError> {
    let document = Document::parse(name, text)?;
    document.decode::<AirframeNumbers>()?.check(&document.root())
}

fn vehicle(text: &str) -> Result<Airframe, ConfigError> {
    let document = Document::parse("vehicle.yaml", text)?;
    document.decode::<VehicleConfig>()?.check(&document.root())
}

/// What is wrong with `cf2x.yaml` where `right` is `wrong`.
fn message(right: &str, wrong: &str) -> String {
    let text = shipped("cf2x");
    assert_eq!(text.matches(right).count(), 1, "{right}");
    airframe("mine.yaml", &text.replace(right, wrong)).unwrap_err().to_string()
}

/// A drone in the form of gym-pybullet-drones' files, with four rotors at `rotors`.
fn urdf(rotors: [&str; 4]) -> String {
    let links: Vec<String> = rotors
        .iter()
        .enumerate()
        .map(|(index, place)| {
            format!(
                "  <link name=\"prop{index}_link\"><inertial><origin rpy=\"0 0 0\" xyz=\"{place}\"/>\
                 <mass value=\"0\"/></inertial></link>\n"
            )
        })
        .collect();
    format!(
        "<?xml version=\"1.0\" ?>\n<robot name=\"mine\">\n  <properties arm=\"0.0397\" kf=\"3.16e-10\" km=\"7.94e-12\" \
         thrust2weight=\"2.25\" max_speed_kmh=\"30\"\n    gnd_eff_coeff=\"11.36859\" prop_radius=\"2.31348e-2\" \
         drag_coeff_xy=\"9.1785e-7\" drag_coeff_z=\"10.311e-7\"\n    dw_coeff_1=\"2267.18\" dw_coeff_2=\".16\" \
         dw_coeff_3=\"-.11\"/>\n  <link name=\"base_link\">\n    <inertial><origin rpy=\"0 0 0\" xyz=\"0 0 0\"/>\
         <mass value=\"0.027\"/>\n      <inertia ixx=\"1.4e-5\" ixy=\"0.0\" ixz=\"0.0\" iyy=\"1.4e-5\" iyz=\"0.0\" \
         izz=\"2.17e-5\"/></inertial>\n    <collision><origin rpy=\"0 0 0\" xyz=\"0 0 0\"/>\n      \
         <geometry><cylinder radius=\".06\" length=\".025\"/></geometry></collision>\n  </link>\n{}</robot>\n",
        links.concat()
    )
}

/// Rotors of the reference's Crazyflie today.
const CLOCKWISE: [&str; 4] = ["0.028 -0.028 0", "-0.028 -0.028 0", "-0.028 0.028 0", "0.028 0.028 0"];

/// Those that name and file give to the bit.
const KNOWN: [(&str, Airframe); 8] = [
    ("cf2x", CF2X),
    ("crazyflie_2_1_plus", CRAZYFLIE_2_1_PLUS),
    ("crazyflie_2_1_thrust_upgrade", CRAZYFLIE_2_1_THRUST_UPGRADE),
    ("bolt_5_inch", BOLT_5_INCH),
    ("x500", X500),
    ("cf2p", CF2P),
    ("hb", HUMMINGBIRD),
    ("racer", RACER),
];

#[test]
fn every_shipped_airframe_can_be_flown() {
    let files = std::fs::read_dir(asset("")).unwrap();
    let names: Vec<PathBuf> = files.map(|file| file.unwrap().path()).collect();
    assert!(names.len() > KNOWN.len());
    for path in names {
        let airframe = read_airframe(&path).unwrap_or_else(|error| panic!("{error}"));
        assert!(airframe.thrust_limit() > 1.5 * airframe.weight(), "{}", path.display());
    }
}

#[test]
fn shipped_airframes_are_the_constants() {
    for (name, constant) in KNOWN {
        assert_eq!(read_airframe(&asset(&format!("{name}.yaml"))).unwrap(), constant, "{name}");
    }
    // Its torque is rounded in SI units, not in RPM.
    let shipped = read_airframe(&asset("crazyflie_2_1.yaml")).unwrap();
    let torque = CRAZYFLIE_2_1.torque_coefficient;
    assert!((shipped.torque_coefficient / torque - 1.0).abs() < 1e-12);
    assert_eq!(Airframe { torque_coefficient: torque, ..shipped }, CRAZYFLIE_2_1);
    // So are its thrust and its greatest speed.
    let shipped = read_airframe(&asset("crazyflie_2_1_brushless.yaml")).unwrap();
    let known = CRAZYFLIE_2_1_BRUSHLESS;
    let Airframe { thrust_coefficient, torque_coefficient, rotor_speed_limit, .. } = known;
    assert!((shipped.thrust_coefficient / thrust_coefficient - 1.0).abs() < 1e-6);
    assert!((shipped.torque_coefficient / torque_coefficient - 1.0).abs() < 1e-6);
    assert!((shipped.rotor_speed_limit / rotor_speed_limit - 1.0).abs() < 1e-6);
    let exact = Airframe { thrust_coefficient, torque_coefficient, rotor_speed_limit, ..shipped };
    assert_eq!(exact, CRAZYFLIE_2_1_BRUSHLESS);
}

#[test]
fn a_vehicle_is_a_name_or_numbers() {
    let inline: Vec<String> = shipped("hb").lines().map(|line| format!("  {line}")).collect();
    assert_eq!(vehicle(&format!("airframe:\n{}\n", inline.join("\n"))).unwrap(), HUMMINGBIRD);
    let real = [("crazyflie_2_1", CRAZYFLIE_2_1), ("crazyflie_2_1_brushless", CRAZYFLIE_2_1_BRUSHLESS)];
    for (name, constant) in KNOWN.into_iter().chain(real) {
        assert_eq!(vehicle(&format!("airframe: {name}")).unwrap(), constant);
    }
    let fork = vehicle("airframe: cf2x\nrotor_order: fork").unwrap();
    assert_eq!(fork, CF2X.numbered(RotorOrder::CounterClockwise));
    let upstream = vehicle("airframe: cf2p\nrotor_order: upstream").unwrap();
    assert_eq!(upstream, CF2P.numbered(RotorOrder::CounterClockwise));
}

#[test]
fn numbers_survive_being_written() {
    for name in KNOWN.map(|(name, _)| name).into_iter().chain(["crazyflie_2_1", "crazyflie_2_1_brushless"]) {
        let document = Document::parse(name, &shipped(name)).unwrap();
        let config = VehicleConfig {
            airframe: AirframeConfig::Custom(document.decode().unwrap()),
            ..VehicleConfig::default()
        };
        let written = serde_yaml::to_string(&config).unwrap();
        assert_eq!(vehicle(&written).unwrap(), config.check(&document.root()).unwrap(), "{written}");
    }
}

#[test]
fn what_is_left_out_has_defaults() {
    let short = "mass_kg: 0.027\ninertia_kg_m2: [1.4e-5, 1.4e-5, 2.17e-5]\nlayout: {cross: {x_m: 0.03, y_m: 0.04}}\n\
                 thrust_n_per_rpm2: 3.16e-10\ntorque_nm_per_rpm2: 7.94e-12\nrotor_speed_limit_rpm: 21000\n\
                 propeller_radius_m: 0.02\ncollision: {radius_m: 0.06, height_m: 0.02}\n";
    let airframe = airframe("short.yaml", short).unwrap();
    assert!((airframe.arm - 0.05).abs() < 1e-15);
    assert!((airframe.rotor_rise_secs - CF2X.rotor_rise_secs).abs() < 1e-12);
    assert_eq!(airframe.rotor_order, RotorOrder::Clockwise);
    assert_eq!(airframe.drag_coefficients.planar, 0.0);
}

#[test]
fn wrong_numbers_are_named() {
    let cases = [
        ("mass_kg: 0.027", "mass_kg: -0.027", "mass_kg: found -0.027, expected a number from 0.001 to 100 kg"),
        ("mass_kg: 0.027", "mass_kg: 0.2", "found 21702.64377525105, expected 41"),
        ("mass_kg: 0.027\n", "", "found no key `mass_kg`"),
        ("mass_kg", "mass_kgs", "found the unknown key `mass_kgs`"),
        ("2.17e-5]", "2.9e-5]", "inertia_kg_m2.2: found 2.9e-5, expected at most the sum of the other two"),
        ("2.17e-5]", "0]", "inertia_kg_m2.2: found 0"),
        ("x_m: 0.028", "x_m: 0", "layout.cross.x_m: found 0"),
        ("{ cross: { x_m: 0.028, y_m: 0.028 } }", "ring", "expected `cross` or `plus`"),
        ("rotor_order: clockwise", "rotor_order: widdershins", "expected `clockwise` or `counter_clockwise`"),
        ("3.16e-10", ".nan", "thrust_n_per_rpm2: found .nan"),
        ("7.94e-12", "0", "torque_nm_per_rpm2: found 0, expected not zero"),
        ("rotor_rise_secs: 0.069090909", "rotor_rise_secs: 0", "rotor_rise_secs: found 0"),
        ("radius_m: 0.06", "radius_m: fat", "collision.radius_m: found the text \"fat\", expected a number"),
    ];
    for (right, wrong, expected) in cases {
        let message = message(right, wrong);
        assert!(message.starts_with("mine.yaml:") && message.contains(expected), "{message}");
    }
    let message = vehicle("airframe: cf2y").unwrap_err().to_string();
    assert!(
        message.contains("found `cf2y`, expected `cf2x`, `crazyflie_2_1`, `crazyflie_2_1_brushless`, ")
            && message.contains("`bolt_5_inch`, `x500`, `cf2p`, `hb` or `racer`"),
        "{message}"
    );
    let message = vehicle("airframe: [1]").unwrap_err().to_string();
    assert!(message.contains("or an airframe in numbers"), "{message}");
}

#[test]
fn an_order_beside_numbers_is_refused() {
    let inline: Vec<String> = shipped("cf2x").lines().map(|line| format!("  {line}")).collect();
    let message =
        vehicle(&format!("rotor_order: fork\nairframe:\n{}\n", inline.join("\n"))).unwrap_err().to_string();
    assert!(message.starts_with("vehicle.yaml:1:14: rotor_order: found an order beside"), "{message}");
}

#[test]
fn a_urdf_is_the_same_drone() {
    let read = airframe("mine.urdf", &urdf(CLOCKWISE)).unwrap();
    let speed_limit = read.rotor_speed_limit;
    assert!((speed_limit / CF2X.rotor_speed_limit - 1.0).abs() < 1e-12);
    // The file knows no rotor lag: the default is the Crazyflie's, computed.
    assert!((read.rotor_fall_secs / CF2X.rotor_fall_secs - 1.0).abs() < 1e-12);
    let same = Airframe {
        rotor_speed_limit: CF2X.rotor_speed_limit,
        rotor_rise_secs: CF2X.rotor_rise_secs,
        rotor_fall_secs: CF2X.rotor_fall_secs,
        ..read
    };
    assert_eq!(same, CF2X);
}

#[test]
fn the_rotors_of_a_urdf_say_their_layout_and_order() {
    let [right, behind_right, behind_left, left] = CLOCKWISE;
    let mirrored = airframe("fork.urdf", &urdf([left, behind_left, behind_right, right])).unwrap();
    assert_eq!(mirrored.rotor_order, RotorOrder::CounterClockwise);
    let plus = airframe("p.urdf", &urdf(["0.04 0 0", "0 0.04 0", "-0.04 0 0", "0 -0.04 0"])).unwrap();
    assert_eq!((plus.layout, plus.rotor_order), (Layout::Plus { arm: 0.04 }, RotorOrder::CounterClockwise));
    let jointed = urdf(CLOCKWISE).replace("<origin rpy=\"0 0 0\" xyz=\"0.028 -0.028 0\"/>", "");
    let joint = "<joint name=\"j\" type=\"fixed\"><origin xyz=\"0.028 -0.028 0\"/><parent link=\"base_link\"/>\
                 <child link=\"prop0_link\"/></joint></robot>";
    let jointed = airframe("j.urdf", &jointed.replace("</robot>", joint)).unwrap();
    assert_eq!(jointed.layout, CF2X.layout);
}

#[test]
fn wrong_urdf_files_are_named_with_their_lines() {
    let cases = [
        ("<robot", "<rabbit", "bad.urdf:16:1: found a syntax error (expected 'rabbit' tag, not 'robot'"),
        ("kf=\"3.16e-10\"", "kf=\"much\"", "bad.urdf:3:32: kf: found \"much\", expected a number"),
        ("kf=\"3.16e-10\" ", "", "bad.urdf:3:3: found <properties> without `kf`, expected a URDF in"),
        ("mass value=\"0.027\"", "mass value=\"-1\"", "bad.urdf:7:61: mass_kg: found -1, expected"),
        ("ixy=\"0.0\"", "ixy=\"1e-7\"", "expected 0: body axes that are the principal axes"),
        ("prop3_link", "prop4_link", "bad.urdf:2:1: found no link `prop3_link`"),
        ("cylinder radius=\".06\" length=\".025\"", "sphere radius=\".06\"", "<geometry> without <cylinder>"),
        ("xyz=\"-0.028 0.028 0\"", "xyz=\"-0.028 0.128 0\"", "expected a symmetric cross or plus"),
        ("xyz=\"-0.028 0.028 0\"", "xyz=\"-0.028 0.028\"", "expected three numbers"),
        ("xyz=\"-0.028 0.028 0\"", "xyz=\"-0.028 0.028 0.01\"", "expected 0: in the body plane"),
        ("thrust2weight=\"2.25\"", "thrust2weight=\"1.01\"", "rotor_speed_limit_rpm: found"),
    ];
    for (right, wrong, expected) in cases {
        let text = urdf(CLOCKWISE);
        assert!(text.contains(right), "{right}");
        let message = airframe("bad.urdf", &text.replacen(right, wrong, 1)).unwrap_err().to_string();
        assert!(message.starts_with("bad.urdf:") && message.contains(expected), "{message}");
    }
    for text in
        ["", "no xml", "<robot/>", "<?xml version=\"1.0\"?><!DOCTYPE r [<!ENTITY a \"b\">]><robot>&a;</robot>"]
    {
        assert!(airframe("bad.urdf", text).unwrap_err().to_string().starts_with("bad.urdf:"));
    }
}
