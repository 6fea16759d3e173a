//! A small picture of a scene, by shadow rays on the host.

use glam::DVec3;
use rayon::prelude::*;

use crate::bvh::Bvh;
use crate::eye::EyeView;
use crate::reference::Rays;
use crate::scene::Scene;

/// Rays a receiver: enough to tell penumbra from umbra in most places.
const RAYS: u32 = 24;

/// What a scene looks like, roughly.
#[derive(Debug, Clone, PartialEq)]
pub struct Preview {
    /// Columns of the preview.
    pub width: u32,
    /// Rows of the preview.
    pub height: u32,
    /// Brightness in [0, 1], row-major; `None` where there is nothing.
    pub pixels: Vec<Option<f64>>,
    /// How many receivers the preview has.
    pub receivers: usize,
    /// Receivers that see a part of the light. An estimate, a little low.
    pub penumbra: usize,
}

impl Preview {
    /// Draws `scene` at `width` columns, its height in proportion. Runs on all host threads; the result does not depend
    /// on them.
    #[must_use]
    pub fn new(scene: &Scene, width: u32) -> Self {
        let height = (width * scene.image.height).div_ceil(scene.image.width).max(1);
        let bvh = Bvh::new(&scene.mesh);
        let eye = EyeView::render_with(&bvh, &scene.mesh, &scene.camera, width, height);
        let rays = Rays::new(&scene.light, RAYS);
        let shades: Vec<(f64, f64)> = (0..eye.points.len())
            .into_par_iter()
            .map(|i| {
                let turn = Rays::turn(eye.pixels[i]);
                let visible = rays.visibility(&bvh, eye.points[i], eye.triangles[i], turn);
                let to_light = (scene.light.center() - eye.points[i]).normalize_or(DVec3::Y);
                let facing = eye.normals[i].as_dvec3().dot(to_light).max(0.0);
                (visible, 0.15 + 0.85 * facing * visible)
            })
            .collect();
        let mut picture = Self {
            width,
            height,
            pixels: vec![None; (width * height) as usize],
            receivers: eye.points.len(),
            penumbra: shades.iter().filter(|&&(visible, _)| visible > 0.0 && visible < 1.0).count(),
        };
        for (&pixel, &(_, shade)) in eye.pixels.iter().zip(&shades) {
            picture.pixels[pixel as usize] = Some(shade);
        }
        picture
    }

    /// Penumbra as a part of the receivers; 0 if there are none.
    #[must_use]
    pub fn penumbra_share(&self) -> f64 {
        self.penumbra as f64 / self.receivers.max(1) as f64
    }

    /// The picture in letters, `columns` wide: a letter stands for a part twice as high as wide.
    #[must_use]
    pub fn text(&self, columns: u32) -> String {
        const LETTERS: &[u8] = b".:-=+*#%@";
        let columns = columns.clamp(1, self.width);
        let rows = (columns * self.height / self.width / 2).max(1);
        let mut text = String::new();
        for row in 0..rows {
            let mut line = String::new();
            for column in 0..columns {
                let span =
                    |k: u32, of: u32, size: u32| k * size / of..((k + 1) * size / of).max(k * size / of + 1);
                let (mut sum, mut covered, mut all) = (0.0, 0, 0);
                for y in span(row, rows, self.height) {
                    for x in span(column, columns, self.width) {
                        all += 1;
                        if let Some(shade) = self.pixels[(y * self.width + x) as usize] {
                            sum += shade;
                            covered += 1;
                        }
                    }
                }
                line.push(if 2 * covered < all {
                    ' '
                } else {
                    let level = sum / f64::from(covered.max(1));
                    LETTERS[((level * LETTERS.len() as f64) as usize).min(LETTERS.len() - 1)] as char
                });
            }
            text.push_str(line.trim_end());
            text.push('\n');
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;

    #[test]
    fn the_picture_does_not_depend_on_host_threads() {
        let scene = crate::load_scene("saloon-small", Path::new(".")).expect("shipped");
        let with = |threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().expect("threads");
            pool.install(|| Preview::new(&scene, 64))
        };
        assert_eq!(with(1), with(3));
    }
}
