//! The images of a simulation's drones, taken at their pace.

use std::sync::Arc;

use crate::camera::{Canvas, Image, OnboardCamera, Scene};
use crate::scenario::Scenario;
use crate::world::Pose;

/// The cameras of all drones; none of them where the scenario has none.
#[derive(Clone, Debug)]
pub(super) struct Imaging {
    camera: OnboardCamera,
    scene: Arc<Scene>,
    canvas: Canvas,
    image: Image,
    /// `[rows][image]`: what each drone saw last.
    images: Vec<u8>,
    /// The same before the reset, of drones whose episode ended in the last step.
    final_images: Vec<u8>,
}

impl Imaging {
    pub(super) fn new(scenario: &Scenario, rows: usize) -> Option<Self> {
        let camera = scenario.camera.clone()?;
        let bytes = rows * camera.image_len();
        Some(Self {
            scene: Arc::new(Scene::new(&scenario.aviary.world)),
            canvas: Canvas::default(),
            image: Image::default(),
            images: vec![0; bytes],
            final_images: vec![0; bytes],
            camera,
        })
    }

    pub(super) fn images(&self) -> &[u8] {
        &self.images
    }

    pub(super) fn images_mut(&mut self) -> &mut [u8] {
        &mut self.images
    }

    pub(super) fn final_images(&self) -> &[u8] {
        &self.final_images
    }

    /// Takes the image of a drone in the control period of its episode, if it is time for one.
    pub(super) fn look(&mut self, row: usize, drone: &Pose, period: u32) {
        if !self.camera.is_due(period) {
            return;
        }
        let view = self.camera.view(drone);
        self.scene.render_into(&self.camera.camera, &view, &mut self.canvas, &mut self.image);
        let len = self.camera.image_len();
        self.camera.write(&self.image, &mut self.images[row * len..][..len]);
    }

    /// Keeps what a drone saw last before it starts anew.
    pub(super) fn keep(&mut self, row: usize) {
        let len = self.camera.image_len();
        let place = row * len..(row + 1) * len;
        self.final_images[place.clone()].copy_from_slice(&self.images[place]);
    }
}
