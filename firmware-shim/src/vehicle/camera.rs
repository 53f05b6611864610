//! A camera beside the autopilot: a component of its own, which says where its video stream is.

use kestrel_onboard::acknowledgement::{CommandResult, command_ack};
use kestrel_onboard::endpoint::Endpoint;
use kestrel_onboard::request::Address;
use kestrel_onboard::signature::{SignatureTime, Signer};
use kestrel_onboard::signature_guard::SignatureGuard;

use super::Vehicle;
use super::channel::Channel;
use crate::link::Peer;
use crate::message::sent::camera::{self, CameraProfile};
use crate::policy_backend::PolicyBackend;
use crate::request::{CommandRequest, Request};
use crate::telemetry::TelemetryStream;

/// `MAV_COMP_ID_CAMERA`.
const COMPONENT: u8 = 100;

/// Answers that wait at once.
const ANSWERS: usize = 8;

/// A camera, and its end of the line.
pub(super) struct Camera {
    profile: CameraProfile,
    system: u8,
    endpoint: Endpoint<ANSWERS>,
}

impl Camera {
    /// One that signs what it says, if it is to; what it hears has been admitted before.
    fn new(system: u8, profile: CameraProfile, signer: Option<Signer>) -> Self {
        let mut endpoint = Endpoint::new(system, COMPONENT);
        if let Some(signer) = signer {
            endpoint.secure(SignatureGuard::Open, signer);
        }
        Self { profile, system, endpoint }
    }

    /// Lets the clock have reached a time, for signatures.
    pub(super) fn advance_clock(&mut self, now: SignatureTime) {
        self.endpoint.advance_clock(now);
    }

    /// Answers a command that is meant for it alone.
    pub(super) fn handle(&mut self, address: Address, request: &Request, sender: [u8; 2], time_boot_ms: u32) {
        let Request::Command(command) = request else { return };
        if address.component != COMPONENT || !address.reaches(self.system, COMPONENT) {
            return;
        }
        let result = self.execute(command, time_boot_ms);
        self.endpoint.answer(command_ack(command.command, result, sender));
    }

    fn execute(&mut self, command: &CommandRequest, time_boot_ms: u32) -> CommandResult {
        let message_id = match command.command {
            512 => command.parameters[0],
            521 => 259.0,
            522 => 260.0,
            525 => 261.0,
            527 => 262.0,
            2504 => 269.0,
            2505 => 270.0,
            // The stream runs whatever is started or stopped: whoever plays it has it.
            2502 | 2503 => return CommandResult::Accepted,
            _ => return CommandResult::Unsupported,
        };
        let told = match message_id {
            0.0 => camera::heartbeat(),
            259.0 => camera::information(&self.profile, time_boot_ms),
            260.0 => camera::settings(time_boot_ms),
            261.0 => camera::storage(time_boot_ms),
            262.0 => camera::capture_status(time_boot_ms),
            269.0 => camera::stream_information(&self.profile),
            270.0 => camera::stream_status(&self.profile),
            _ => return CommandResult::Denied,
        };
        self.endpoint.answer(told);
        CommandResult::Accepted
    }

    /// Sends a peer what waits.
    pub(super) fn answer(&mut self, channel: &mut Channel, send: &mut dyn FnMut(&[u8])) {
        while let Some(payload) = self.endpoint.next_payload() {
            send(&self.endpoint.encode_numbered(&payload, &mut channel.camera_sequence));
        }
    }
}

impl<P: PolicyBackend> Vehicle<P> {
    /// Has a camera on board from now on, of which peers are told.
    pub fn carry_camera(&mut self, profile: CameraProfile) {
        self.camera = Some(Camera::new(self.profile.system, profile, self.signer.clone()));
    }

    /// The camera's heartbeat, beside that of the autopilot.
    pub(super) fn publish_camera(&mut self, send: &mut dyn FnMut(Peer, &[u8])) {
        let Some(camera) = &mut self.camera else { return };
        for channel in self.channels.due(TelemetryStream::Heartbeat, self.controller.ticks()) {
            let frame = camera.endpoint.encode_numbered(&camera::heartbeat(), &mut channel.camera_sequence);
            send(channel.peer, &frame);
        }
    }
}
