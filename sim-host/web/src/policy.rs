//! A policy file that the page has loaded.

use kestrel_core::fixed::FixedScratch;
use kestrel_core::policy_file::{ParameterFormat, PolicyError};
use kestrel_export::policy::Policy;
use wasm_bindgen::prelude::*;

/// A policy file. What is loaded stays loaded for as long as the page is open: everything that flies borrows from it.
#[wasm_bindgen]
#[derive(Clone, Copy, Debug)]
pub struct WebPolicy {
    file: &'static Policy<'static>,
}

#[wasm_bindgen]
impl WebPolicy {
    /// The policy in a whole file, whose golden vectors it computes again.
    ///
    /// # Errors
    /// When the file is damaged or of another version.
    #[wasm_bindgen(constructor)]
    pub fn load(bytes: Vec<u8>) -> Result<Self, JsError> {
        Ok(Self::of(bytes)?)
    }

    /// The name of its experiment.
    #[wasm_bindgen(getter)]
    pub fn name(&self) -> String {
        self.file.metadata().name.to_owned()
    }

    /// `fixed16` or `float32`.
    #[wasm_bindgen(getter)]
    pub fn arithmetic(&self) -> String {
        self.file.arithmetic().name().to_owned()
    }

    /// Whether it flies to a point that anybody may choose: it sees its goal, and nothing that only its task has.
    #[wasm_bindgen(getter)]
    pub fn is_free(&self) -> bool {
        self.file.flies_anywhere()
    }

    /// Values that each layer reads, and those of the action; empty for a policy that remembers or looks at images.
    #[wasm_bindgen(getter)]
    pub fn widths(&self) -> Vec<usize> {
        let Policy::Blind(policy) = self.file else { return Vec::new() };
        let inputs = policy.shapes().map(|(inputs, _)| inputs);
        inputs.chain([self.file.metadata().action.len()]).collect()
    }
}

impl WebPolicy {
    /// As [`Self::load`].
    ///
    /// # Errors
    /// When the file is damaged or of another version.
    pub(crate) fn of(bytes: Vec<u8>) -> Result<Self, PolicyError> {
        let file = Policy::parse(Box::leak(bytes.into_boxed_slice()))?;
        file.self_test()?;
        Ok(Self { file: Box::leak(Box::new(file)) })
    }

    pub(crate) fn file(&self) -> &'static Policy<'static> {
        self.file
    }

    /// What each layer reads for an observation, as shares of one, layer after layer, and the action; what is computed in float, or
    /// from more than an observation, shows nothing.
    pub(crate) fn activations(&self, observation: &[f32]) -> Vec<f32> {
        let Policy::Blind(policy) = self.file else { return Vec::new() };
        let (Some(network), ParameterFormat::Fixed16(format)) = (policy.fixed(), policy.parameter_format()) else {
            return Vec::new();
        };
        let mut scratch = FixedScratch::new();
        let mut values = Vec::new();
        for layer in 0..policy.shapes().count() {
            let one = (1_u32 << format.fraction_bits_into(layer)) as f32;
            let codes = network.activations(layer, observation, &mut scratch);
            values.extend(codes.iter().map(|code| f32::from(*code) / one));
        }
        let action = network.act(observation, &mut scratch);
        values.extend(&action[..policy.metadata().action.len()]);
        values
    }
}
