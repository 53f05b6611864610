//! A whole autopilot behind a UART: bytes of MAVLink in, rotor targets and bytes out.
//!
//! The loop is that of a microcontroller; here two queues play its UART and a simulated floor plays the drone.
//! Run it with `cargo run -p kestrel-onboard --example mavlink_over_a_uart`.

use std::collections::VecDeque;
use std::error::Error;

use kestrel_core::airframe::CF2X;
use kestrel_core::pilot::Pilot;
use kestrel_core::policy_file::{Aligned, PolicyFile};
use kestrel_onboard::autopilot::Mode;
use kestrel_onboard::dialect::checksum_seed;
use kestrel_onboard::flight_controller::{FlightController, VehicleIdentity};
use kestrel_onboard::frame::{Encoder, Payload};
use kestrel_onboard::geodesy::Home;
use kestrel_onboard::plant::{FlatFloor, Plant};

/// A trained policy, in flash.
static POLICY: Aligned<{ include_bytes!("../../../assets/pilots/hover.kestrel").len() }> =
    Aligned(*include_bytes!("../../../assets/pilots/hover.kestrel"));

/// What your board calls its UART.
#[derive(Default)]
struct Uart {
    received: VecDeque<u8>,
    sent: Vec<u8>,
}

fn main() -> Result<(), Box<dyn Error>> {
    let policy = PolicyFile::parse(&POLICY.0).map_err(|error| format!("no policy: {error}"))?;
    let identity = VehicleIdentity { system: 1, origin: Home::default() };
    let mut controller: FlightController<_> = FlightController::new(Pilot::new(policy), &CF2X, identity);
    let mut drone = FlatFloor::new(&CF2X, controller.autopilot().control_secs());
    let mut uart = Uart::default();
    let mut ground_station = Encoder::new(255, 190);
    for period in 0..600 {
        match period {
            // MAV_CMD_COMPONENT_ARM_DISARM and MAV_CMD_NAV_TAKEOFF, of a ground station at the other end.
            50 => uart.received.extend(ground_station.encode(&command_long(400, 1.0))),
            100 => uart.received.extend(ground_station.encode(&command_long(22, 0.0))),
            _ => {}
        }
        // What follows is the loop of the firmware, once per control period.
        while let Some(byte) = uart.received.pop_front() {
            controller.receive(byte);
        }
        while let Some(frame) = controller.next_answer() {
            uart.sent.extend(frame);
        }
        let battery = 1.0;
        let rotor_targets = controller.tick(drone.state(), battery);
        drone.step(&rotor_targets);
    }
    let (mode, height_m) = (controller.autopilot().mode(), drone.state().position.z);
    println!("{}, {height_m:.2} m above the floor; {} bytes of acknowledgements", mode.name(), uart.sent.len());
    if mode == Mode::Holding { Ok(()) } else { Err("it should hover".into()) }
}

/// `COMMAND_LONG` of a command, its first parameter, and the others left open, to component 1 of system 1.
fn command_long(command: u16, first: f32) -> Payload {
    let mut fields = [0; 33];
    let parameters = [first, 0.0, f32::NAN, f32::NAN, f32::NAN, f32::NAN, f32::NAN];
    fields[..28].copy_from_slice(parameters.map(f32::to_le_bytes).as_flattened());
    fields[28..30].copy_from_slice(&command.to_le_bytes());
    fields[30..32].copy_from_slice(&[1, 1]);
    Payload::new(76, checksum_seed(76).unwrap_or_default(), &fields)
}

#[test]
fn it_takes_off() {
    main().expect("it hovers");
}
