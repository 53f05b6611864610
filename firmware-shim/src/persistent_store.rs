//! What outlives a flight: the parameters, and the times of signatures.

use std::path::PathBuf;
use std::time::{Duration, Instant, SystemTime};

use kestrel_onboard::signature::SignatureTime;
use kestrel_onboard::signature_guard::SignatureGuard;

use crate::parameter::file::{self, FileError};
use crate::policy_backend::PolicyBackend;
use crate::signing::{SignatureTimes, Signing, SigningError};
use crate::vehicle::Vehicle;

/// Times are kept so often \[wall time\]: what a crash may lose.
const INTERVAL: Duration = Duration::from_secs(1);

/// Something cannot be kept.
#[derive(Debug, thiserror::Error)]
pub enum PersistentStoreError {
    /// The parameters.
    #[error(transparent)]
    Parameters(#[from] FileError),
    /// The key, or the times beside it.
    #[error(transparent)]
    Signing(#[from] SigningError),
}

/// Keeps what a vehicle would lose.
#[derive(Debug)]
pub struct PersistentStore {
    parameters: Option<PathBuf>,
    signing: Option<Signing>,
    kept: Instant,
}

impl PersistentStore {
    /// For a vehicle, which gets what was kept: its parameters from a file, if there is one already, and the signatures of a key.
    ///
    /// # Errors
    /// If a file cannot be read, or holds something else.
    pub fn open<P: PolicyBackend>(
        vehicle: &mut Vehicle<P>,
        parameters: Option<PathBuf>,
        key: Option<PathBuf>,
    ) -> Result<Self, PersistentStoreError> {
        if let Some(path) = parameters.as_ref().filter(|path| path.exists()) {
            let mut values = vehicle.parameters().clone();
            file::read(path, &mut values)?;
            vehicle.adjust(values);
        }
        let signing = key.map(|path| Signing::open(&path)).transpose()?;
        if let Some(signing) = &signing {
            let now = wall_time();
            vehicle.secure(SignatureGuard::Signed(signing.verifier(now)), signing.signer(now));
        }
        Ok(Self { parameters, signing, kept: Instant::now() })
    }

    /// At the beginning of a control period: what the clock says.
    pub fn begin_period<P: PolicyBackend>(&self, vehicle: &mut Vehicle<P>) {
        if self.signing.is_some() {
            vehicle.advance_clock(wall_time());
        }
    }

    /// At its end: keeps what has changed.
    ///
    /// # Errors
    /// If it cannot be written.
    pub fn end_period<P: PolicyBackend>(&mut self, vehicle: &mut Vehicle<P>) -> Result<(), PersistentStoreError> {
        if vehicle.take_changes()
            && let Some(path) = &self.parameters
        {
            file::save(path, vehicle.parameters())?;
        }
        if self.kept.elapsed() >= INTERVAL {
            self.finish(vehicle)?;
        }
        Ok(())
    }

    /// At the end of a flight.
    ///
    /// # Errors
    /// If the times cannot be written.
    pub fn finish<P: PolicyBackend>(&mut self, vehicle: &Vehicle<P>) -> Result<(), PersistentStoreError> {
        self.kept = Instant::now();
        match (&mut self.signing, vehicle.signature_times()) {
            (Some(signing), Some([accepted, sent])) => Ok(signing.keep(SignatureTimes { accepted, sent })?),
            (_, _) => Ok(()),
        }
    }
}

fn wall_time() -> SignatureTime {
    let since_1970 = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
    SignatureTime::from_unix_micros(since_1970.as_micros() as u64)
}
