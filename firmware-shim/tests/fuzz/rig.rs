//! A vehicle in its plant, above the endless floor.

use std::path::Path;
use std::sync::LazyLock;

use kestrel_core::airframe::CF2X;
use kestrel_core::pilot::{Pilot, StatePolicy};
use kestrel_onboard::signature::{SignatureTime, Signer, SigningKey};
use kestrel_onboard::signature_guard::{SignatureGuard, Verifier};
use kestrel_shim::geodesy::Home;
use kestrel_shim::link::{EndpointId, Peer};
use kestrel_shim::message::sent::identity::PolicyIdentity;
use kestrel_shim::personality::Personality;
use kestrel_shim::plant::{FlatFloor, Plant};
use kestrel_shim::policy_bytes::PolicyBytes;
use kestrel_shim::vehicle::{Vehicle, VehicleProfile};

use crate::request::VEHICLE;

const POLICY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../assets/pilots/hover.kestrel");

pub(crate) struct Rig {
    pub(crate) vehicle: Vehicle<Pilot<'static, StatePolicy<'static>>>,
    pub(crate) plant: FlatFloor,
    /// What it answered since the last control period.
    answers: Vec<Vec<u8>>,
}

/// Who speaks to it and listens.
const PEER: Peer = Peer { link: 0, endpoint: EndpointId::ONLY };

impl Rig {
    /// A disarmed vehicle that knows its state.
    pub(crate) fn new() -> Self {
        static BYTES: LazyLock<PolicyBytes> =
            LazyLock::new(|| PolicyBytes::read(Path::new(POLICY)).expect("the policy is there"));
        let profile = VehicleProfile {
            system: VEHICLE[0],
            personality: Personality::Generic,
            origin: Home::default(),
            policy: PolicyIdentity::of("hover", BYTES.bytes()),
        };
        let policy = BYTES.policy().expect("a policy");
        let vehicle = Vehicle::new(Pilot::with_runner(policy), &CF2X, profile);
        let plant = FlatFloor::new(&CF2X, vehicle.control_period().as_secs_f32());
        let mut rig = Self { vehicle, plant, answers: Vec::new() };
        rig.tick(&mut |_| {});
        rig
    }

    /// One that hears only what this key signed after a time, and signs with it.
    pub(crate) fn signing(key: &SigningKey, floor: SignatureTime) -> Self {
        let mut rig = Self::new();
        let verifier = Verifier::new(key.clone(), floor, floor);
        rig.vehicle.secure(SignatureGuard::Signed(verifier), Signer::new(key.clone(), 0, floor));
        rig
    }

    /// Whether the datagram was good.
    pub(crate) fn receive(&mut self, datagram: &[u8]) -> bool {
        let answers = &mut self.answers;
        self.vehicle.receive(PEER, datagram, &mut |frame| answers.push(frame.to_vec()))
    }

    /// A control period; `send` gets the frames, answers of before first.
    pub(crate) fn tick(&mut self, send: &mut dyn FnMut(&[u8])) -> [f32; 4] {
        self.answers.drain(..).for_each(|frame| send(&frame));
        let targets = self.vehicle.tick(self.plant.state(), &[PEER], &mut |_, frame| send(frame));
        self.plant.step(&targets);
        targets
    }
}
