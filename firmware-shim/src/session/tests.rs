#![expect(clippy::wildcard_enum_match_arm, reason = "a message is one of the dialect's hundreds")]

use std::cell::RefCell;
use std::collections::VecDeque;
use std::fs;
use std::io::{Read, Write};
use std::net::{TcpStream, UdpSocket};
use std::thread;
use std::time::Duration;

use clap::Parser;
use kestrel_core::airframe::CF2X;
use mavlink::dialects::common::{COMMAND_ACK_DATA, HEARTBEAT_DATA, MavCmd, MavMessage, MavResult};

use super::*;
use crate::autopilot::Mode;
use crate::controller::Controller;
use crate::flight_mode::FlightMode;
use crate::frame::Frames;
use crate::link::DATAGRAM_LIMIT;
use crate::plant::FlatFloor;
use crate::policy_bytes::PolicyBytes;
use crate::testing::{
    blind_policy, command_long, datagram, dishonest_policy, hover_policy, read_flight_log, sensing_policy,
    set_point, told,
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
    /// What came together with what was waited for.
    unread: RefCell<VecDeque<MavMessage>>,
}

impl Client {
    fn of(session: &Session<Pilot<'_, StatePolicy<'_>>>) -> Self {
        let socket = UdpSocket::bind("127.0.0.1:0").unwrap();
        socket.connect(session.bound().udp).unwrap();
        socket.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
        Self { socket, unread: RefCell::default() }
    }

    fn send(&self, bytes: &[u8]) {
        self.socket.send(bytes).unwrap();
    }

    fn wait_for<T>(&self, wanted: impl Fn(&MavMessage) -> Option<T>) -> T {
        let mut buffer = [0; DATAGRAM_LIMIT];
        loop {
            while let Some(message) = self.unread.borrow_mut().pop_front() {
                if let Some(found) = wanted(&message) {
                    return found;
                }
            }
            let len = self.socket.recv(&mut buffer).unwrap();
            let frames = Frames::new(&buffer[..len]).flatten();
            self.unread.borrow_mut().extend(frames.filter_map(|frame| told(frame.bytes)));
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
                (heartbeat.custom_mode == FlightMode::of(mode, Controller::Policy).custom_mode()).then_some(())
            }
            _ => None,
        });
    }
}

#[test]
fn options_have_the_customary_defaults() {
    assert_eq!(parsed("").unwrap(), SessionOptions::default());
    assert_eq!(parsed("--speed max --for-secs 2.5").unwrap().speed, SimulationRate::Unthrottled);
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
        ("--tcp 5760", "expected an IP address"),
        ("--serial :57600", "expected PATH or PATH:BAUD"),
        ("--link-faults loss=2", "expected a probability of 0 to 1"),
        ("--log-start 0", "--log"),
        ("--log flight.tlog --log-start 4102444801", "4102444800"),
        ("--crtp 19850", "invalid socket address"),
        ("--crtp 127.0.0.1:19850 --signing-key key", "cannot be used with"),
    ] {
        let error = parsed(arguments).unwrap_err();
        assert!(error.contains(expected), "{error}");
    }
}

#[test]
fn the_announcement_names_policy_and_addresses() {
    let bytes = PolicyBytes::copy_of(&hover_policy());
    let session = Session::open(&bytes, &CF2X, &anywhere("--speed 5")).unwrap();
    let address = session.bound().udp;
    for expected in ["linear hover", "5 times", "udpin:127.0.0.1:9", &format!("udpout:{address}")] {
        assert!(session.announcement().contains(expected), "{}", session.announcement());
    }
}

#[test]
fn whoever_listens_beyond_the_loopback_is_told_so() {
    let bytes = PolicyBytes::copy_of(&hover_policy());
    let announced =
        |options: &SessionOptions| Session::open(&bytes, &CF2X, options).unwrap().announcement().to_owned();
    let warning = "Reachable from other machines";
    assert!(!announced(&anywhere("--tcp 127.0.0.1:0")).contains(warning));
    let everywhere = announced(&parsed("--listen 0.0.0.0:0 --ground-station 127.0.0.1:9").unwrap());
    assert_eq!(everywhere.matches(warning).count(), 1, "{everywhere}");
    assert!(announced(&anywhere("--tcp 0.0.0.0:0")).contains(warning));
}

#[test]
fn a_tcp_address_has_a_customary_port() {
    assert_eq!(parsed("--tcp 127.0.0.1").unwrap().tcp, Some("127.0.0.1:5760".parse().unwrap()));
    assert_eq!(parsed("--tcp ::1").unwrap().tcp, Some("[::1]:5760".parse().unwrap()));
    assert_eq!(parsed("--tcp 127.0.0.1:5763").unwrap().tcp, Some("127.0.0.1:5763".parse().unwrap()));
}

#[test]
fn a_crazyflie_is_announced_where_it_is_wanted() {
    let bytes = PolicyBytes::copy_of(&hover_policy());
    let without = Session::open(&bytes, &CF2X, &anywhere("")).unwrap();
    assert!(!without.announcement().contains("cflib"), "{}", without.announcement());
    let session = Session::open(&bytes, &CF2X, &anywhere("--crtp 127.0.0.1:0")).unwrap();
    let address = session.bound().crtp.unwrap();
    let line = format!("\n  cflib           udp://{address}\n");
    assert!(session.announcement().contains(&line), "{}", session.announcement());
}

#[test]
fn a_crazyflie_answers_over_the_loopback() {
    let bytes = PolicyBytes::copy_of(&hover_policy());
    let mut session = Session::open(&bytes, &CF2X, &anywhere("--crtp 127.0.0.1:0")).unwrap();
    let client = UdpSocket::bind("127.0.0.1:0").unwrap();
    client.set_read_timeout(Some(Duration::from_secs(10))).unwrap();
    client.connect(session.bound().crtp.unwrap()).unwrap();
    client.send(&[0xFF]).unwrap();
    let mut moments = 0;
    let mut watch = |_: &ControlPeriod| {
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
    let error = Session::open(&bytes, &CF2X, &anywhere("")).err().unwrap();
    assert!(matches!(error, SessionError::SelfTest { .. }), "{error}");
}

#[test]
fn a_policy_that_sees_no_goal_takes_no_commands() {
    let bytes = PolicyBytes::copy_of(&blind_policy());
    let error = Session::open(&bytes, &CF2X, &anywhere("")).err().unwrap();
    assert_eq!(
        error.to_string(),
        "policy \"linear hover\" has the observation `measured`, which does not show where to fly: a vehicle that \
         takes commands needs one trained with `pilot`"
    );
}

#[test]
fn a_policy_that_needs_sensors_does_not_fly_without() {
    let bytes = PolicyBytes::copy_of(&sensing_policy());
    let error = Session::open(&bytes, &CF2X, &anywhere("")).err().unwrap();
    assert!(matches!(error, SessionError::SensorsMissing { observation: "pilot_measured", .. }), "{error}");
}

#[test]
fn a_busy_port_is_an_error() {
    let bytes = PolicyBytes::copy_of(&hover_policy());
    let first = Session::open(&bytes, &CF2X, &anywhere("")).unwrap();
    let options = SessionOptions { listen: first.bound().udp, ..anywhere("") };
    let error = Session::open(&bytes, &CF2X, &options).err().unwrap();
    assert!(matches!(error, SessionError::Link(LinkError::Busy { .. })), "{error}");
}

#[test]
fn a_flight_ends_when_its_time_is_up() {
    let bytes = PolicyBytes::copy_of(&hover_policy());
    let mut session = Session::open(&bytes, &CF2X, &anywhere("--speed max --for-secs 5")).unwrap();
    let mut moments = 0;
    let mut watch = |_: &ControlPeriod| {
        moments += 1;
        Next::Fly
    };
    session.fly(&mut FlatFloor::new(&CF2X, 0.01), &mut watch).unwrap();
    assert_eq!(moments, 501, "both ends of 500 periods");
}

#[test]
fn a_busy_tcp_port_a_wrong_device_and_a_log_in_no_folder_are_errors() {
    let bytes = PolicyBytes::copy_of(&hover_policy());
    let first = Session::open(&bytes, &CF2X, &anywhere("--tcp 127.0.0.1:0")).unwrap();
    let refusal = |more: &str| Session::open(&bytes, &CF2X, &anywhere(more)).err().unwrap();
    let error = refusal(&format!("--tcp {}", first.bound().tcp.unwrap()));
    assert!(matches!(error, SessionError::Link(LinkError::Busy { .. })), "{error}");
    let error = refusal("--serial no/such/device");
    assert!(matches!(error, SessionError::Link(LinkError::Open { .. })), "{error}");
    let error = refusal("--log no/such/folder/flight.tlog");
    assert!(matches!(error, SessionError::Log(_)), "{error}");
}

#[test]
fn a_tcp_client_arms_and_everything_is_logged() {
    let bytes = PolicyBytes::copy_of(&hover_policy());
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("flight.tlog");
    let options = format!("--tcp 127.0.0.1:0 --speed 10 --log-start 5 --log {}", log.display());
    let mut session = Session::open(&bytes, &CF2X, &anywhere(&options)).unwrap();
    let mut stream = TcpStream::connect(session.bound().tcp.unwrap()).unwrap();
    let arm = [1.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
    let command = datagram(&command_long(MavCmd::MAV_CMD_COMPONENT_ARM_DISARM, arm));
    let mut watch = |period: &ControlPeriod| {
        if period.secs > 1.0 && period.mode == Mode::Disarmed {
            stream.write_all(&command).unwrap();
        }
        assert!(period.secs < 200.0, "never armed");
        if period.mode == Mode::Armed { Next::End } else { Next::Fly }
    };
    session.fly(&mut FlatFloor::new(&CF2X, 0.01), &mut watch).unwrap();
    let entries = read_flight_log(&fs::read(log).unwrap());
    assert!(entries.iter().any(|(_, frame)| *frame == command));
    assert!(entries.iter().all(|(time_us, _)| (5_000_000..205_000_000).contains(time_us)));
    let mut told = vec![0; entries[0].1.len()];
    stream.read_exact(&mut told).unwrap();
    assert!(entries.iter().any(|(_, frame)| *frame == told));
}

#[test]
fn a_squadron_counts_up_and_ends_together() {
    let bytes = PolicyBytes::copy_of(&hover_policy());
    let folder = tempfile::tempdir().unwrap();
    let log = folder.path().join("flight.tlog");
    let options = format!("--speed max --for-secs 1 --system 5 --log {}", log.display());
    let mut fleet = Fleet::open(&bytes, &CF2X, 3, &anywhere(&options)).unwrap();
    assert!(fleet.announcement().contains("systems 5 to 7"), "{}", fleet.announcement());
    for session in fleet.sessions() {
        let address = format!("udpout:{}", session.bound().udp);
        assert!(fleet.announcement().contains(&address), "{}", fleet.announcement());
    }
    let mut moments = [0; 3];
    let mut plants = [0.0, 1.0, 2.0].map(|x_m| FlatFloor::new(&CF2X, 0.01).at([x_m, 0.0]));
    fleet
        .fly(&mut plants, &mut |period| {
            moments[period.number] += 1;
            Next::Fly
        })
        .unwrap();
    assert_eq!(moments, [101; 3]);
    for system in [5, 6, 7] {
        let entries = read_flight_log(&fs::read(folder.path().join(format!("flight-{system}.tlog"))).unwrap());
        assert!(entries.iter().all(|(_, frame)| frame[5] == system));
    }
}

#[test]
fn a_squadron_of_one_is_a_session() {
    let bytes = PolicyBytes::copy_of(&hover_policy());
    let fleet = Fleet::open(&bytes, &CF2X, 1, &anywhere("")).unwrap();
    assert_eq!(fleet.announcement(), fleet.sessions()[0].announcement());
}

#[test]
fn a_squadron_without_numbers_ports_or_lines_for_all_is_refused() {
    let bytes = PolicyBytes::copy_of(&hover_policy());
    for (options, expected) in [
        ("--system 249", "expected systems up to 250, found the first to be system 249"),
        ("--listen 127.0.0.1:65534", "expected ports up to 65535, found the first to listen at 127.0.0.1:65534"),
        ("--tcp 127.0.0.1:65535 --listen 127.0.0.1:0", "expected ports up to 65535"),
        ("--serial /dev/null", "expected no serial line, found /dev/null"),
    ] {
        let options = parsed(options).unwrap();
        let error = Fleet::open(&bytes, &CF2X, 3, &options).err().unwrap();
        assert!(matches!(error, SessionError::Fleet { count: 3, .. }), "{error}");
        assert!(error.to_string().contains(expected), "{error}");
    }
}

#[test]
fn a_client_flies_over_the_loopback_through_a_shower_of_garbage() {
    let bytes = PolicyBytes::copy_of(&hover_policy());
    let mut session =
        Session::open(&bytes, &CF2X, &anywhere("--speed 50 --for-secs 2000 --personality generic")).unwrap();
    let client = Client::of(&session);
    let pilot = thread::spawn(move || {
        let garbage = |i: u8| client.send(&vec![i.wrapping_mul(37); 3 * usize::from(i)]);
        (1..100).for_each(garbage);
        // A vehicle that has not flown a control period yet has no state, and refuses to arm.
        client.send(&datagram(&HEARTBEAT_DATA::default()));
        client.wait_for_mode(Mode::Disarmed);
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
    let mut watch = |_: &ControlPeriod| if pilot.is_finished() { Next::End } else { Next::Fly };
    let counts = session.fly(&mut FlatFloor::new(&CF2X, 0.01), &mut watch).unwrap();
    pilot.join().unwrap();
    assert!(counts.garbage >= 100, "{counts:?}");
    assert!(counts.frames >= 5, "{counts:?}");
}
