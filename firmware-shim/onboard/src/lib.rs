//! What a vehicle carries on board, on a microcontroller as in software in the loop: the autopilot, and the MAVLink that commands it.
//!
//! No allocation, no clock, no socket, and no panic that can be reached. Read in the order of the data: bytes from a peer are
//! cut into checked [`frame`]s, whose checksums need the seeds of the [`dialect`]; a [`signature`] says who sent them, the
//! [`endpoint`] who is heard, and a [`request`] what is asked for, which is an [`order`] to the [`autopilot`] and gets an
//! [`acknowledgement`]. It obeys, watches for what can go wrong ([`failsafe`], [`fence`], [`battery`]), moves the [`goal`] and
//! has the policy of a [`policy_backend`] or the cascade of controllers ([`steering`]) fly there ([`controller`]). All of that together
//! is a [`flight_controller`]. The [`plant`] is a simulation to fly in where there is no drone.
//!
//! A vehicle is a loop around a [`FlightController`](flight_controller::FlightController):
//!
//! ```
//! use kestrel_core::policy_file::{Aligned, PolicyFile};
//! use kestrel_core::{airframe::CF2X, pilot::Pilot, vehicle::State};
//! use kestrel_onboard::flight_controller::{FlightController, VehicleIdentity};
//! use kestrel_onboard::geodesy::Home;
//! use kestrel_onboard::plant::{FlatFloor, Plant};
//!
//! /// A control period: bytes of the UART and an estimated state in, frames and rotor targets [rad/s] out.
//! fn period(
//!     controller: &mut FlightController<Pilot>,
//!     received: &[u8],
//!     state: &State<f32>,
//!     send: &mut dyn FnMut(&[u8]),
//! ) -> [f32; 4] {
//!     for byte in received {
//!         controller.receive(*byte);
//!     }
//!     while let Some(frame) = controller.next_answer() {
//!         send(&frame);
//!     }
//!     controller.tick(state, 1.0)
//! }
//!
//! let file = Aligned(*include_bytes!("../../../assets/pilots/hover.kestrel"));
//! let policy = PolicyFile::parse(&file.0).expect("a policy");
//! let identity = VehicleIdentity { system: 1, origin: Home::default() };
//! let mut controller = FlightController::new(Pilot::new(policy), &CF2X, identity);
//! let drone = FlatFloor::new(&CF2X, controller.autopilot().control_secs());
//! let targets = period(&mut controller, &[], drone.state(), &mut |_| {});
//! assert_eq!(targets, [0.0; 4], "disarmed");
//! ```

#![cfg_attr(not(any(test, feature = "testing")), no_std)]

pub mod acknowledgement;
pub mod autopilot;
pub mod axes;
pub mod battery;
pub mod checksum;
pub mod controller;
pub mod dialect;
pub mod endpoint;
pub mod excerpt;
pub mod failsafe;
pub mod fence;
pub mod fields;
pub mod flight_controller;
pub mod flight_mode;
pub mod frame;
pub mod geodesy;
pub mod goal;
pub mod order;
pub mod plant;
pub mod policy_backend;
pub mod repetition;
pub mod request;
pub mod settings;
pub mod sha256;
pub mod signature;
pub mod signature_guard;
pub mod steering;
#[cfg(any(test, feature = "testing"))]
pub mod testing;
