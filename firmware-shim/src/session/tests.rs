use std::net::UdpSocket;
use std::thread;
use std::time::Duration;

use clap::Parser;
use kestrel_core::airframe::CF2X;
use mavlink::dialects::common::{COMMAND_ACK_DATA, MavCmd, MavMessage, MavResult};

use super::*;
use crate::autopilot::Mode;
use crate::link::DATAGRAM_LIMIT;
use crate::plant::FlatFloor;
use crate::policy_bytes::PolicyBytes;
use crate::testing::{
    blind_policy, command_long, datagram, dishonest_policy, hover_policy, message, sensing_policy, set_point,
};

const PARAMETERS_OPEN: [f32; 7] = [f32::NAN; 7];

#[derive(Parser)]
struct Line {
    #[command(flatten)]
    options: SessionOptions,
}

fn parsed(arguments: &str) -> Result<SessionOptions, String> {
    let words = ["test"].into_iter().chain(arguments.split_whitespace());
    Line::try_parse_from(words).map(|line| line.options).map_err(|error| error.to_string())
}

/// Any free port, and a ground station that is nowhere.
fn anywhere(more: &str) -> SessionOptions {
    parsed(&format!("--listen 127.0.0.1:0 --ground-station 127.0.0.1:9 {more}")).unwrap()
}

/// A client on the loopback that has a vehicle's address.
struct Client {
    socket: UdpSocket,
}

impl Client {
    fn of(session: &Session<Pilot<'_>>) -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.connect(session.link.address().unwrap()).unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        Self { socket }
    }

    fn send(&self, bytes: &[u8]) {
        self.socket.send(bytes).unwrap();
    }

    fn wait_for<T>(&self, wanted: impl Fn(&MavMessage) -> Option<T>) -> T {
        let mut buffer = [0; DATAGRAM_LIMIT];
        loop {
            let len = self.socket.recv(&mut buffer).unwrap();
            if let Some(found) = wanted(&message(&buffer[..len])) {
                return found;
            }
        }
    }

    fn command(&self, command: MavCmd, parameters: [f32; 7]) -> MavResult {
        self.send(&datagram(&command_long(command, parameters)));
        self.wait_for(|message| match message {
            MavMessage::COMMAND_ACK(COMMAND_ACK_DATA { command: answered, result }) if *answered == command => {
                Some(*result)
            }
            _ => None,
        })
    }

    fn wait_for_mode(&self, mode: Mode) {
        self.wait_for(|message| match message {
            MavMessage::HEARTBEAT(heartbeat) => {
                (heartbeat.custom_mode == crate::message::sent::mode_number(mode)).then_some(())
            }
            _ => None,
        });
    }
}

#[test]
fn options_have_the_customary_defaults() {
    assert_eq!(parsed("").unwrap(), SessionOptions::default());
    assert_eq!(parsed("--speed max --for-secs 2.5").unwrap().speed, Pace::Unthrottled);
}

#[test]
fn wrong_options_are_refused_in_one_message() {
    for (arguments, expected) in [
        ("--system 0", "1..=250"),
        ("--system 251", "1..=250"),
        ("--speed fast", "found \"fast\""),
        ("--for-secs -1", "expected a positive number of seconds"),
        ("--for-secs=-1", "expected a positive number of seconds"),
        ("--for-secs nan", "expected a positive number of seconds"),
        ("--listen 14580", "invalid socket address"),
        ("--crtp 19850", "invalid socket address"),
    ] {
        let error = parsed(arguments).unwrap_err();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn the_announcement_names_policy_and_addresses() {
    let bytes = PolicyBytes::copy_of(&hover_policy());
    let session = Session::open(bytes.policy().unwrap(), &anywhere("--speed 5")).unwrap();
    let address = session.link.address().unwrap();
    for expected in ["linear hover", "5 times", "udpin:127.0.0.1:9", &format!("udpout:{address}")] {
        assert!(session.announcement().contains(expected), "{}", session.announcement());
    }
}

#[test]
fn a_crazyflie_is_announced_where_it_is_wanted() {
    let bytes = PolicyBytes::copy_of(&hover_policy());
    let without = Session::open(bytes.policy().unwrap(), &anywhere("")).unwrap();
    assert!(!without.announcement().contains("cflib"), "{}", without.announcement());
    let session = Session::open(bytes.policy().unwrap(), &anywhere("--crtp 127.0.0.1:0")).unwrap();
    let address = session.crtp.as_ref().unwrap().address().unwrap();
    let line = format!("\n  cflib           udp://{address}\n");
    assert!(session.announcement().contains(&line), "{}", session.announcement());
}

#[test]
fn a_crazyflie_answers_over_the_loopback() {
    let bytes = PolicyBytes::copy_of(&hover_policy());
    let mut session = Session::open(bytes.policy().unwrap(), &anywhere("--crtp 127.0.0.1:0")).unwrap();
    let client = UdpSocket::bind("127.0.0.1:0").unwrap();
    client.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    client.connect(session.crtp.as_ref().unwrap().address().unwrap()).unwrap();
    client.send(&[0xFF]).unwrap();
    let mut moments = 0;
    let mut watch = |_: &Moment| {
        moments += 1;
        if moments < 10 { Next::Fly } else { Next::End }
    };
    session.fly(&mut FlatFloor::new(&CF2X, 0.01), &mut watch).unwrap();
    let mut buffer = [0; 8];
    assert_eq!(client.recv(&mut buffer).unwrap(), 1);
    assert_eq!(buffer[0], 0xFF);
}

#[test]
fn a_policy_that_fails_its_self_test_does_not_take_the_air() {
    let bytes = PolicyBytes::copy_of(&dishonest_policy());
    let error = Session::open(bytes.policy().unwrap(), &anywhere("")).err().unwrap();
    assert!(matches!(error, SessionError::SelfTest { .. }), "{error}");
}

#[test]
fn a_policy_that_sees_no_goal_takes_no_commands() {
    let bytes = PolicyBytes::copy_of(&blind_policy());
    let error = Session::open(bytes.policy().unwrap(), &anywhere("")).err().unwrap();
    assert_eq!(
        error.to_string(),
        "policy \"linear hover\" has the observation `measured`, which does not show where to fly: a vehicle that \
         takes commands needs one trained with `pilot`"
    );
}

#[test]
fn a_policy_that_needs_sensors_does_not_fly_without() {
    let bytes = PolicyBytes::copy_of(&sensing_policy());
    let error = Session::open(bytes.policy().unwrap(), &anywhere("")).err().unwrap();
    assert!(matches!(error, SessionError::SensorsMissing { observation: "pilot_measured", .. }), "{error}");
}

#[test]
fn a_busy_port_is_an_error() {
    let bytes = PolicyBytes::copy_of(&hover_policy());
    let first = Session::open(bytes.policy().unwrap(), &anywhere("")).unwrap();
    let options = SessionOptions { listen: first.link.address().unwrap(), ..anywhere("") };
    let error = Session::open(bytes.policy().unwrap(), &options).err().unwrap();
    assert!(matches!(error, SessionError::Link(LinkError::Busy { .. })), "{error}");
}

#[test]
fn a_flight_ends_when_its_time_is_up() {
    let bytes = PolicyBytes::copy_of(&hover_policy());
    let mut session = Session::open(bytes.policy().unwrap(), &anywhere("--speed max --for-secs 5")).unwrap();
    let mut moments = 0;
    let mut watch = |_: &Moment| {
        moments += 1;
        Next::Fly
    };
    session.fly(&mut FlatFloor::new(&CF2X, 0.01), &mut watch).unwrap();
    assert_eq!(moments, 501, "both ends of 500 periods");
}

#[test]
fn a_client_flies_over_the_loopback_through_a_shower_of_garbage() {
    let bytes = PolicyBytes::copy_of(&hover_policy());
    let mut session = Session::open(bytes.policy().unwrap(), &anywhere("--speed 50 --for-secs 2000")).unwrap();
    let client = Client::of(&session);
    let pilot = thread::spawn(move || {
        let garbage = |i: u8| client.send(&vec![i.wrapping_mul(37); 3 * usize::from(i)]);
        (1..100).for_each(garbage);
        assert_eq!(
            client.command(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]),
            MavResult::MAV_RESULT_ACCEPTED
        );
        assert_eq!(client.command(MavCmd::MAV_CMD_NAV_TAKEOFF, PARAMETERS_OPEN), MavResult::MAV_RESULT_ACCEPTED);
        client.wait_for_mode(Mode::Holding);
        (1..100).for_each(garbage);
        client.send(&datagram(&set_point([f32::NAN, 0.0, -1.0])));
        client.send(&datagram(&set_point([0.5, 0.0, -1.0])));
        client.wait_for(|message| match message {
            MavMessage::LOCAL_POSITION_NED(position) => ((position.x - 0.5).abs() < 0.05).then_some(()),
            _ => None,
        });
        assert_eq!(client.command(MavCmd::MAV_CMD_NAV_LAND, PARAMETERS_OPEN), MavResult::MAV_RESULT_ACCEPTED);
        client.wait_for_mode(Mode::Disarmed);
    });
    let mut watch = |_: &Moment| if pilot.is_finished() { Next::End } else { Next::Fly };
    let counts = session.fly(&mut FlatFloor::new(&CF2X, 0.01), &mut watch).unwrap();
    pilot.join().unwrap();
    assert!(counts.garbage >= 100, "{counts:?}");
    assert!(counts.frames >= 5, "{counts:?}");
}
