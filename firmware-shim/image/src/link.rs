//! The same frames everywhere: a signed MAVLink stream, damaged on its way, as a vehicle on board would hear it.

use kestrel_onboard::frame::{Encoder, Payload, Receiver};
use kestrel_onboard::signature::{SignatureTime, Signer, SigningKey};
use kestrel_onboard::signature_guard::Verifier;

use crate::digest::Digest;
use crate::input::Inputs;
use crate::machine::{Verdict, hexadecimal, print};

/// Frames of the stream.
const FRAMES: u32 = 500;

/// One of so many bytes is damaged.
const DAMAGE: u32 = 300;

/// `COMMAND_LONG`, and the seed of its checksum.
const MESSAGE: (u32, u8) = (76, 152);

/// Bytes of its fields.
const FIELDS: usize = 33;

/// Some time in 2027.
const START: SignatureTime = SignatureTime(4_000_000_000_000);

/// Prints the digest of what was sent and of what was heard.
pub fn run() -> Verdict {
    let mut digest = Digest::new();
    let accepted = stream(&mut digest);
    let digits = hexadecimal(digest.value());
    print(&["frames: 500 signed, damaged ", core::str::from_utf8(&digits).unwrap_or_default(), "\n"]);
    // Damage meets about one frame in six.
    if (FRAMES / 2..FRAMES).contains(&accepted) { Verdict::Passed } else { Verdict::Failed }
}

/// How many frames were accepted.
fn stream(digest: &mut Digest) -> u32 {
    let key = SigningKey([7; 32]);
    let mut encoder = Encoder::new(255, 190).signed(Signer::new(key.clone(), 1, START));
    let mut receiver = Receiver::new();
    let mut verifier = Verifier::new(key, START, SignatureTime(0));
    let mut inputs = Inputs::new(5);
    let mut accepted = 0;
    for _ in 0..FRAMES {
        let fields: [u8; FIELDS] = core::array::from_fn(|_| inputs.bits() as u8);
        for &byte in &encoder.encode(&Payload::new(MESSAGE.0, MESSAGE.1, &fields)) {
            digest.add_bytes(&[byte]);
            let damaged = inputs.bits().is_multiple_of(DAMAGE);
            let heard = receiver.push(if damaged { byte ^ 0x10 } else { byte });
            let Some(Ok(frame)) = heard else { continue };
            let verdict = verifier.verify(&frame);
            digest.add_bytes(&[u8::from(verdict.is_ok()), frame.sequence]);
            digest.add_bytes(frame.payload);
            accepted += u32::from(verdict.is_ok());
        }
    }
    accepted
}
