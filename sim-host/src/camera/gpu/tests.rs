//! The GPU's images beside the processor's, in every world of `assets/worlds`. Needs an adapter: a GPU, or
//! mesa-vulkan-drivers.

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use nalgebra::Vector3;

use super::*;
use crate::camera::tests::strewn;
use crate::camera::{Camera, FLOOR, Image, Renderer, Shot, View};
use crate::config::{File, world};
use crate::seed::{Purpose, Seed, Stream};
use crate::world::World;

/// Poses in each world; as many as a software adapter renders at once.
const POSES: usize = SOFTWARE_VIEWS;
