use std::collections::BTreeMap;

use kestrel_core::airframe::CF2X;
use kestrel_core::pilot::{Pilot, StatePolicy};
use kestrel_shim::autopilot::Mode;
use kestrel_shim::lockstep::{ControlPeriod, Next, SimulationRate};
use kestrel_shim::plant::FlatFloor;
use kestrel_shim::policy_bytes::PolicyBytes;
use kestrel_shim::session::{Session, SessionOptions};

use super::*;
use crate::message::{Header, Time, Triple};

/// The tests' own domain, in which nobody else is.
const DOMAIN: u16 = 101;

fn settings(domain: &str, middleware: &str) -> Result<NodeSettings, String> {
    let given: BTreeMap<_, _> = [("ROS_DOMAIN_ID", domain), ("RMW_IMPLEMENTATION", middleware)].into();
    NodeSettings::of_variables(|name| given.get(name).map(|text| (*text).to_owned()))
        .map_err(|error| error.to_string())
}

#[test]
fn settings_are_those_of_ros() {
    let set = |domain, mapping| Ok(NodeSettings { domain, mapping });
    assert_eq!(settings("", ""), set(0, Middleware::FastDds));
    assert_eq!(settings("232", "rmw_cyclonedds_cpp"), set(232, Middleware::CycloneDds));
    assert_eq!(settings("233", "").unwrap_err(), "ROS_DOMAIN_ID: found `233`, expected 0 to 232");
    assert!(settings("", "rmw_zenoh_cpp").unwrap_err().contains("expected one that speaks DDS"));
}

#[test]
fn names_are_those_that_ros_takes() {
    assert!(["cf1", "cf_231", "C"].into_iter().all(is_name));
    assert!(["", "1cf", "_cf", "cf-1", "cf__1", "cf/1", "für"].into_iter().all(|name| !is_name(name)));
    let refused = RosLink::open("cf-1", 1, Home::default(), &NodeSettings::default()).err().unwrap().to_string();
    assert!(refused.starts_with("found the ROS 2 name `cf-1`, expected a letter"), "{refused}");
}

/// Another node on the same wire; that of another maker flies in `tests/python/ros2_test.py`.
#[test]
fn another_node_has_it_take_off_and_reads_where_it_is() {
    let bytes = PolicyBytes::copy_of(include_bytes!("../../../../assets/pilots/hover.kestrel"));
    let nowhere = "127.0.0.1:9".parse().unwrap();
    let options = SessionOptions {
        listen: "127.0.0.1:0".parse().unwrap(),
        ground_station: nowhere,
        speed: SimulationRate::Speed(4.0),
        ..SessionOptions::default()
    };
    let mut session = Session::<Pilot<'_, StatePolicy<'_>>>::open(&bytes, &CF2X, &options).unwrap();
    let settings = NodeSettings { domain: DOMAIN, ..NodeSettings::default() };
    let link = RosLink::open("cf1", 1, Home::default(), &settings).unwrap();
    session.attach(Box::new(link), "node").unwrap();

    let context = Context::with_options(ContextOptions::new().domain_id(DOMAIN)).unwrap();
    let mut node = context.new_node(NodeName::new("/", "client").unwrap(), NodeOptions::new()).unwrap();
    let quality = QosProfile::publisher_default();
    let service = ServiceTypeName::new("crazyflie_interfaces", "Takeoff");
    let mapping = settings.mapping.of_services();
    let client = node
        .create_client::<Takeoff, Empty>(mapping, &place("all", "takeoff"), &service, quality.clone(), quality)
        .unwrap();
    let hover = node.create_topic(
        &place("cf1", "cmd_velocity_world"),
        type_of::<VelocityWorld>(),
        &QosProfile::publisher_default(),
    );
    let hover = node.create_publisher::<VelocityWorld>(&hover.unwrap(), None).unwrap();
    let mut asked_secs = -1.0;
    let mut watch = |period: &ControlPeriod| {
        // Until they have found each other, requests are lost.
        if period.mode == Mode::Disarmed && period.secs - asked_secs > 1.0 {
            asked_secs = period.secs;
            client.send_request(Takeoff { group_mask: 0, height: 0.6, duration: Time::of(1.0) }).unwrap();
        }
        if matches!(period.mode, Mode::Holding | Mode::Offboard) {
            let vel = Triple { x: 0.3, y: 0.0, z: 0.0 };
            hover.publish(VelocityWorld { header: Header::default(), vel, yaw_rate: 0.0 }).unwrap();
        }
        assert!(period.secs < 300.0, "never there");
        if period.state.position.x > 0.5 { Next::End } else { Next::Fly }
    };
    session.fly(&mut FlatFloor::new(&CF2X, 0.01), &mut watch).unwrap();
}
