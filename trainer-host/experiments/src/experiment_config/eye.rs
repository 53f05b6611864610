//! How a policy with a camera looks at its images.

use kestrel_core::encoder::Convolution;
use kestrel_sim::camera::OnboardCamera;
use kestrel_sim::config::{ConfigError, Field};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::training::hidden;
use crate::drone_environment::image_of;
use kestrel_learn::ppo::{EncoderKind, EncoderSettings, EncoderSharing};

/// The convolutional network between the camera and the policy.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct EyeConfig {
    /// Its convolutions and features.
    pub network: EyeNetworkConfig,
    /// Whether actor and critic look through the same eye, which then learns from both.
    pub shared: bool,
    /// Widths of layers that read the observation and the features before the layers of actor and critic do; none where
    /// those read both themselves.
    pub trunk: Vec<u64>,
}

/// Convolutions with a rectifier behind each, then a dense layer with one.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum EyeNetworkConfig {
    /// 16 filters of 8×8 pixels, each 4 further (4×4 and 2 where the image has less than 40 rows or columns), 32 of 4×4,
    /// each 2 further, and 64 features: what two cores can train.
    Small,
    /// That of Mnih et al. 2015: 32 filters of 8×8, 64 of 4×4, 64 of 3×3, 4, 2 and 1 apart.
    Nature(NatureConfig),
    /// Others.
    Custom(CustomEyeConfig),
}

/// The network of Mnih et al. 2015.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(default, deny_unknown_fields)]
pub struct NatureConfig {
    /// Stable-Baselines3 has 512 for images alone and 256 beside other inputs.
    pub features: u64,
}

/// Convolutions of your own.
#[derive(Clone, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct CustomEyeConfig {
    /// One after the other, without padding.
    pub convolutions: Vec<ConvolutionConfig>,
    /// Outputs of the dense layer behind them.
    pub features: u64,
}

/// One convolution.
#[derive(Clone, Copy, Debug, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct ConvolutionConfig {
    /// Channels of its output.
    pub filters: u64,
    /// Rows and columns of a filter.
    pub kernel: u64,
    /// Pixels from one place of a filter to the next.
    pub stride: u64,
}

impl Default for EyeConfig {
    fn default() -> Self {
        Self { network: EyeNetworkConfig::Small, shared: true, trunk: Vec::new() }
    }
}

impl Default for NatureConfig {
    fn default() -> Self {
        Self { features: 256 }
    }
}

impl EyeConfig {
    pub(super) fn check(&self, field: &Field<'_>) -> Result<EncoderSettings, ConfigError> {
        Ok(EncoderSettings {
            kind: self.network.check(&field.at("network"))?,
            sharing: if self.shared { EncoderSharing::Shared } else { EncoderSharing::Separate },
            trunk: match self.trunk.as_slice() {
                [] => Vec::new(),
                widths => hidden(widths, &field.at("trunk"))?,
            },
        })
    }
}

impl EyeNetworkConfig {
    fn check(&self, field: &Field<'_>) -> Result<EncoderKind, ConfigError> {
        match self {
            Self::Small => Ok(EncoderKind::Small),
            Self::Nature(NatureConfig { features }) => {
                Ok(EncoderKind::Nature { features: count(*features, &field.at("nature").at("features"))? })
            }
            Self::Custom(CustomEyeConfig { convolutions, features }) => {
                let field = field.at("custom");
                let convolution = |(index, convolution): (usize, &ConvolutionConfig)| {
                    convolution.check(&field.at("convolutions").at(index))
                };
                let convolutions = convolutions.iter().enumerate().map(convolution).collect::<Result<_, _>>()?;
                Ok(EncoderKind::Custom { convolutions, features: count(*features, &field.at("features"))? })
            }
        }
    }
}

impl ConvolutionConfig {
    fn check(&self, field: &Field<'_>) -> Result<Convolution, ConfigError> {
        Ok(Convolution {
            filters: count(self.filters, &field.at("filters"))?,
            kernel: count(self.kernel, &field.at("kernel"))?,
            stride: count(self.stride, &field.at("stride"))?,
        })
    }
}

fn count(value: u64, field: &Field<'_>) -> Result<u16, ConfigError> {
    Ok(field.whole(value, 1..=1024)? as u16)
}

/// Refuses an eye that the images of a camera do not suit; `field` is the training's.
pub(super) fn refuse_unsuited_encoder(
    encoder: &EncoderSettings,
    camera: Option<&OnboardCamera>,
    field: &Field<'_>,
) -> Result<(), ConfigError> {
    match camera.map(|camera| (camera, encoder.kind.cnn(image_of(camera)))) {
        None | Some((_, Ok(_))) => Ok(()),
        Some((camera, Err(error))) => {
            let (rows, columns) = (camera.camera.rows, camera.camera.columns);
            let found = format!("an eye for images of {rows} rows, {columns} columns: {error}");
            Err(field.at("eye").at("network").reject(found, "an eye that suits the scenario's camera"))
        }
    }
}
