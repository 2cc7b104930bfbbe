//! A name that is kept for a visitor who is about to come in.

use std::{
    mem,
    sync::{Arc, Mutex, MutexGuard, PoisonError},
};

use sightline_protocol::{fingerprint::KeyFingerprint, text::Name};
use tokio::time::Instant;

use super::{
    names::forms_of,
    state::{Registry, ServerState},
};
use crate::bus::name_claims::{NameAnswer, PATIENCE};

/// A name that nobody else gets. It is let go when it is dropped, unless it was taken. Do not drop
/// it while the registry is locked.
pub struct KeptName {
    registry: Arc<Mutex<Registry>>,
    name: Option<Name>,
}

impl KeptName {
    /// Keeps a name for the owner of a key, who wants one: one that no visitor of this station has
    /// and, as far as the bus says so in time, none of another station.
    pub async fn find(state: &ServerState, key: KeyFingerprint, wanted: &Name) -> Self {
        let until = Instant::now() + PATIENCE;
        let mut taken = Vec::new();
        loop {
            let (kept, name, claims) = {
                let mut registry = state.registry();
                let name = registry.names.keep(wanted, &taken);
                let registered = state.registry.clone();
                let kept = Self { registry: registered, name: Some(name.clone()) };
                (kept, name, registry.names.claims().cloned())
            };
            let Some(claims) = claims else { return kept };
            if claims.claim(forms_of(&name), key, until).await != NameAnswer::Taken {
                return kept;
            }
            taken.push(name);
        }
    }

    /// The name, which the caller keeps from now on.
    pub fn take(&mut self) -> Option<Name> {
        mem::take(&mut self.name)
    }

    fn registry(&self) -> MutexGuard<'_, Registry> {
        self.registry.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Drop for KeptName {
    fn drop(&mut self) {
        if let Some(name) = self.take() {
            self.registry().names.drop_kept(&name);
        }
    }
}
