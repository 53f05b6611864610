use std::net::UdpSocket;

use clap::Parser;
use kestrel_core::airframe::{CF2P, CF2X};

use super::betaflight::server::BetaflightAddresses;
use super::*;
use crate::plant::FlatFloor;

#[derive(Debug, Parser)]
struct Line {
    #[command(flatten)]
    options: BridgeOptions,
}

fn parsed(arguments: &str) -> Result<BridgeOptions, String> {
    let words = ["test"].into_iter().chain(arguments.split_whitespace());
    Line::try_parse_from(words).map(|line| line.options).map_err(|error| error.to_string())
}

fn opened(arguments: &str) -> Result<SimulatorBridge, BridgeError> {
    SimulatorBridge::open(&parsed(&format!("--listen 127.0.0.1:0 {arguments}")).unwrap(), &CF2X)
}

#[test]
fn every_peer_has_its_customary_address_and_rate() {
    for (arguments, address, rate_hz) in [
        ("--peer px4", "127.0.0.1:4560", 250),
        ("--peer px4 --instance 3 --rate-hz 500", "127.0.0.1:4563", 500),
        ("--peer ardupilot --instance 2", "127.0.0.1:9022", 1200),
        ("--peer betaflight", "127.0.0.1:9001", 500),
        ("--peer crazyflie --instance 1", "127.0.0.1:19951", 1000),
    ] {
        let options = parsed(arguments).unwrap();
        assert_eq!(options.peer.address(options.instance), address.parse().unwrap());
        assert_eq!(options.rate_hz(), rate_hz);
        assert!((options.control_secs() * rate_hz as f32 - 1.0).abs() < 1e-6);
    }
}

#[test]
fn wrong_options_are_refused_in_one_message() {
    for (arguments, expected) in [
        ("", "--peer"),
        ("--peer jsbsim", "possible values: px4, ardupilot, betaflight"),
        ("--peer px4 --rate-hz 10", "50..=2000"),
        ("--peer px4 --instance 100", "0..=99"),
        ("--peer px4 --home 1,2", "found \"1,2\""),
        ("--peer px4 --noise loud", "found \"loud\""),
        ("--peer px4 --radio 1,2", "found \"1,2\""),
        ("--peer px4 --motors hex", "possible values: quad-x, crazyflie, betaflight"),
        ("--peer crazyflie --motor-thrust 0", "expected a thrust above 0"),
        ("--peer px4 --thrust-curve 1.5", "expected a share from 0 to 1, found \"1.5\""),
        ("--peer px4 --for-secs 0", "expected a positive number of seconds"),
    ] {
        let error = parsed(arguments).unwrap_err();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn the_thrust_of_half_an_output_is_what_the_curve_says() {
    let share = |arguments: &str| {
        let speed = parsed(arguments).unwrap().motors(&CF2X).unwrap().rotor_targets(&[0.5; 4])[0];
        (speed / CF2X.rotor_speed_limit as f32).powi(2)
    };
    assert!((share("--peer px4") - 0.5).abs() < 1e-6);
    assert!((share("--peer px4 --thrust-curve 0.8") - 0.3).abs() < 1e-6);
}

#[test]
fn southern_and_western_homes_need_no_quotes() {
    let home = parsed("--peer px4 --home -35.363261,149.165230,584").unwrap().home;
    assert_eq!(home.latitude_deg, -35.363_261);
}

#[test]
fn what_a_peer_cannot_do_is_said_before_it_waits() {
    for (arguments, expected) in [
        ("--peer betaflight --instance 1", "expected --instance 0, found 1"),
        ("--peer betaflight-legacy --instance 1", "expected --instance 0, found 1"),
        (
            "--peer ardupilot --radio 1500",
            "ArduPilot takes no remote control from its simulator: expected no --radio, found 1500",
        ),
        ("--peer crazyflie --radio 1500", "expected no --radio, found 1500"),
        ("--peer crazyflie --rate-hz 500", "expected --rate-hz 1000 and --speed 1, found --rate-hz 500"),
        ("--peer crazyflie --speed 2", "found another --speed"),
    ] {
        let error = opened(arguments).unwrap_err().to_string();
        assert!(error.contains(expected), "{error}");
    }
    let options = parsed("--peer px4 --listen 127.0.0.1:0").unwrap();
    let error = SimulatorBridge::open(&options, &CF2P).unwrap_err();
    assert!(matches!(error, BridgeError::Motors(_)), "{error}");
}

#[test]
fn a_busy_port_is_one_clear_error_for_tcp_and_udp() {
    for peer in ["px4", "ardupilot", "betaflight", "crazyflie"] {
        let first = opened(&format!("--peer {peer}")).unwrap();
        let address = first.socket.address().unwrap();
        let second = parsed(&format!("--peer {peer} --listen {address}")).unwrap();
        let error = SimulatorBridge::open(&second, &CF2X).unwrap_err();
        assert!(matches!(error, BridgeError::Busy { .. }), "{error}");
        assert!(error.to_string().contains(&address.to_string()), "{error}");
    }
}

#[test]
fn the_announcement_says_what_to_start_and_where_it_waits() {
    for (arguments, expected) in [
        ("--peer px4 --instance 2 --speed max", ["PX4", "bin/px4 -i 2", "as fast as the autopilot answers"]),
        ("--peer ardupilot --noise off", ["ArduPilot", "--model JSON", "without noise"]),
        ("--peer betaflight --speed 0.5", ["Betaflight", "betaflight_SITL", "0.5 times"]),
        ("--peer crazyflie", ["Bitcraze's firmware", "cf2", "in real time"]),
    ] {
        let bridge = opened(arguments).unwrap();
        let address = bridge.socket.address().unwrap().to_string();
        for expected in expected.into_iter().chain([address.as_str()]) {
            assert!(bridge.announcement().contains(expected), "{}", bridge.announcement());
        }
    }
}

#[test]
fn a_bridge_ends_when_its_time_is_up() {
    // Betaflight's simulation runs without it, once its port is open.
    let port = UdpSocket::bind(BetaflightAddresses::default().state);
    let mut bridge = opened("--peer betaflight --speed max --rate-hz 2000 --for-secs 0.05").unwrap();
    let mut plant = FlatFloor::new(&CF2X, bridge.options.control_secs());
    let counts = bridge.fly(&mut plant, &mut |_| Next::Fly).unwrap();
    assert_eq!((counts.steps, counts.answered), (100, 0));
    drop(port);
}
