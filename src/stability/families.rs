//! The families of the study: in each, one thing goes from the plain to the extreme.
//!
//! Every scene is a floor, something over it, a lamp and a camera, a few units large; [`SIZE`] is the side of the floor.

use lrbsim_workloads::glam::{DVec2, DVec3};
use lrbsim_workloads::{Camera, ImageSize, Light, Mesh, Scene, SceneError};

use crate::made::{self, Parts, turned};

/// Side of the floor: what is called the size of a scene.
const SIZE: f64 = 4.0;

/// Radius of the lamp where that is not what is varied.
const RADIUS: f64 = 0.25;

/// One thing that is varied, and the scenes that it is varied in.
pub struct Family {
    /// Name of the family, as in the names of its files.
    pub id: &'static str,
    /// The family for people, as a heading.
    pub title: &'static str,
    /// What is varied, with its unit, as the label of an axis.
    pub axis: &'static str,
    /// What is varied, in a sentence.
    pub varied: &'static str,
    /// What that asks of the program, in a sentence for somebody who has not read the papers.
    pub meaning: &'static str,
    /// The points of the family, from the plain to the extreme or in ascending order.
    pub points: &'static [f64],
    make: fn(f64) -> Setup,
}

impl Family {
    /// Whether the point at `x` takes longer than others.
    pub fn is_dear(&self, x: f64) -> bool {
        match self.id {
            "image" => x > 1000.0,
            "triangles" => x > 1e4,
            "disc" => x > 1e3,
            _ => false,
        }
    }

    /// The scene of the family at `x`.
    ///
    /// # Errors
    /// If the program refuses it.
    pub fn scene(&self, x: f64) -> Result<Scene, SceneError> {
        let Setup { mesh, camera, image, light } = (self.make)(x);
        made::scene(super::NAME, self.id, mesh, light, (camera, image))
    }
}

/// A scene before it is checked.
struct Setup {
    mesh: Mesh,
    camera: Camera,
    image: ImageSize,
    light: Light,
}

impl Setup {
    /// A scene of `parts`, with the camera where it mostly is.
    fn new(parts: Parts, center: DVec3, radius: f64) -> Setup {
        Setup {
            mesh: parts.finish(),
            camera: Camera {
                eye: DVec3::new(0.3, 2.7, 4.3),
                target: DVec3::new(0.0, 0.2, 0.0),
                up: DVec3::Y,
                fov_y_degrees: 48.0,
            },
            image: ImageSize { width: 96, height: 72 },
            light: Light::Sphere { center, radius },
        }
    }

    /// The scene with every point moved by `place`; the light is `scale` times as large.
    fn placed(mut self, scale: f64, place: impl Fn(DVec3) -> DVec3) -> Setup {
        self.mesh.positions.iter_mut().for_each(|p| *p = place(*p));
        self.camera.eye = place(self.camera.eye);
        self.camera.target = place(self.camera.target);
        if let Light::Sphere { center, radius } = &mut self.light {
            *center = place(*center);
            *radius *= scale;
        }
        self
    }
}

fn floor() -> Parts {
    Parts::default().level("floor", DVec3::ZERO, SIZE / 2.0)
}

/// A floor with a block that stands on it and a slanted sheet over it.
fn plain() -> Parts {
    let at = DVec3::new;
    floor()
        .block("block", at(-1.1, 0.0, -0.4), at(-0.5, 0.7, 0.2))
        .quad("sheet", [at(0.1, 0.9, -0.5), at(0.1, 1.1, 0.4), at(0.9, 1.3, 0.4), at(0.9, 1.1, -0.5)])
}

/// Where the lamp mostly hangs.
const LAMP: DVec3 = DVec3::new(0.55, 3.1, -0.35);

fn plain_setup() -> Setup {
    Setup::new(plain(), LAMP, RADIUS)
}

/// All families, in the order of the report.
pub const FAMILIES: &[Family] = &[
    Family {
        id: "scale",
        title: "Scale of the scene",
        axis: "scale",
        varied: "Every length is multiplied by the same number: floor, block, sheet, lamp and camera.",
        meaning: "A model in millimeters and one in kilometers must give the same picture: nothing may depend on the unit.",
        points: &[
            1e-36, 1e-30, 1e-20, 1e-12, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 1.0, 10.0, 1e2, 1e3, 1e4, 1e5,
            1e6, 1e12, 1e20, 1e30, 1e37, 1e39,
        ],
        make: |x| plain_setup().placed(x, |p| p * x),
    },
    Family {
        id: "offset",
        title: "Distance of the scene from the origin",
        axis: "offset, sizes of the scene",
        varied: "The whole scene is moved away from the origin of its coordinates, in 64-bit numbers.",
        meaning: "Cities in map coordinates lie millions of their own sizes from 0, and numbers have only so many digits to \
                  tell neighbors apart: at 1e12 even 64-bit ones know places to 1/2048 of a unit only, of which the floor is 4 wide.",
        points: &[0.0, 1.0, 10.0, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e12],
        make: |x| plain_setup().placed(1.0, |p| p + DVec3::new(1.0, 0.37, -0.61) * (x * SIZE)),
    },
    Family {
        id: "radius",
        title: "Radius of the lamp",
        axis: "radius, sizes of the scene",
        varied: "The lamp grows from a point to a billion sizes of the scene and further; its middle stays.",
        meaning: "A point casts hard shadows and an endless lamp next to none. From about 0.5 on, the floor cuts this lamp; the \
                  larger it is, the lower over the horizon is what hides most of it. What is lower than a millionth of the lamp's \
                  height is left out, by the method and by brute force alike: from some ten thousand sizes on ever more of what \
                  hides the lamp, and rounding tells which; in the end nearly all, and both are wrong by the same.",
        points: &[0.0, 1e-6, 1e-5, 1e-4, 1e-3, 1e-2, 0.1, 0.3, 1.0, 10.0, 1e2, 1e3, 1e4, 1e5, 1e6, 1e9, 1e10],
        make: |x| Setup::new(plain(), LAMP, x * SIZE),
    },
    Family {
        id: "face",
        title: "Lamp over a face",
        axis: "distance of the lamp's middle, radii",
        varied: "The lamp sinks into a level sheet: at 1 it touches it, below 1 it is cut by it, at 0 its middle lies exactly on it.",
        meaning: "The method sees all shadows from the lamp's middle; of a lamp that is cut, a part is on the other side, which has to \
                  be known.",
        points: &[8.0, 4.0, 2.0, 1.01, 1.0, 0.5, 0.1, 1e-2, 1e-4, 1e-6, 1e-9, 0.0],
        make: |x| {
            let sheet = DVec3::new(0.2, 1.3, 0.0);
            let parts = floor().level("sheet", sheet, 0.6);
            Setup::new(parts, sheet + DVec3::new(0.13, RADIUS * x, 0.07), RADIUS)
        },
    },
    Family {
        id: "edge",
        title: "Lamp at an edge",
        axis: "distance of the lamp's middle, radii",
        varied: "The lamp comes slantwise to the edge of a level sheet, until its middle lies exactly on the edge.",
        meaning: "From the middle of the lamp the sheet becomes ever larger, and at 0 it is seen from its own edge.",
        points: &[8.0, 4.0, 2.0, 1.01, 1.0, 0.5, 0.1, 1e-2, 1e-4, 1e-6, 1e-9, 0.0],
        make: |x| {
            let sheet = DVec3::new(-0.5, 1.3, 0.0);
            let parts = floor().level("sheet", sheet, 0.6);
            let along = DVec3::new(0.8, 0.6, 0.0);
            Setup::new(parts, sheet + DVec3::new(0.6, 0.0, 0.07) + along * (RADIUS * x), RADIUS)
        },
    },
    Family {
        id: "corner",
        title: "Lamp at a corner",
        axis: "distance of the lamp's middle, radii",
        varied: "The lamp comes to the corner of a closed block, until its middle lies exactly on the corner.",
        meaning: "Three faces and three edges meet in the lamp. At 1.01 none of them cuts it yet, but parts of the lamp see other \
                  outlines of the block than its middle does.",
        points: &[8.0, 4.0, 2.0, 1.01, 1.0, 0.5, 0.1, 1e-2, 1e-4, 1e-6, 1e-9, 0.0],
        make: |x| {
            let corner = DVec3::new(0.2, 1.3, 0.1);
            let parts = floor().block("block", corner - DVec3::new(0.7, 0.7, 0.7), corner);
            let along = DVec3::new(0.6, 0.64, 0.48);
            Setup::new(parts, corner + along * (RADIUS * x), RADIUS)
        },
    },
    Family {
        id: "inside",
        title: "Lamp inside of a body",
        axis: "depth of the lamp's middle, radii",
        varied: "The middle of the lamp goes down into a closed block: below 1 a part of the lamp still looks out.",
        meaning: "What a closed body holds lights nothing outside of it: where the whole lamp is inside, all is dark.",
        points: &[0.0, 1e-9, 1e-6, 1e-4, 1e-2, 0.1, 0.5, 1.0, 1.01, 1.5, 2.0],
        make: |x| {
            let parts = floor().block("block", DVec3::new(-0.5, 0.5, -0.5), DVec3::new(0.5, 1.5, 0.5));
            Setup::new(parts, DVec3::new(0.11, 1.5 - RADIUS * x, 0.07), RADIUS)
        },
    },
    Family {
        id: "contact",
        title: "Receivers at a contact",
        axis: "gap under the block, sizes of the scene",
        varied: "A block floats over the floor, ever lower, until it stands on it; the camera is near its foot.",
        meaning: "Where things touch, the shadow begins at the contact: a gap must neither open nor close.",
        points: &[0.1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9, 1e-12, 0.0],
        make: |x| {
            let low = DVec3::new(-0.6, SIZE * x, -0.6);
            let parts = floor().block("block", low, low + DVec3::new(1.0, 0.8, 0.8));
            let mut setup = Setup::new(parts, LAMP + DVec3::new(0.0, 0.0, -1.2), RADIUS);
            setup.camera.eye = DVec3::new(0.1, 0.35, 1.1);
            setup.camera.target = DVec3::new(-0.1, 0.02, 0.1);
            setup
        },
    },
    Family {
        id: "grazing",
        title: "Grazing light",
        axis: "height of the lamp's middle over the floor, degrees",
        varied: "The lamp sinks to the horizon of the floor; its own radius is 3.6 degrees.",
        meaning: "At sunset, shadows are endlessly long and the floor is seen edge-on from the lamp.",
        points: &[45.0, 20.0, 10.0, 5.0, 2.0, 1.0, 0.1, 1e-2, 1e-3, 1e-4, 1e-6, 0.0],
        make: |x| {
            let height = DVec2::from_angle(x.to_radians());
            Setup::new(plain(), DVec3::new(height.x * 0.8, height.y, height.x * 0.6) * SIZE, RADIUS)
        },
    },
    Family {
        id: "passing",
        title: "Edges through the plane of the lamp",
        axis: "distance of the sheet, radii",
        varied: "An upright sheet from below to above the lamp comes ever nearer, until it touches it.",
        meaning: "Edges that pass the lamp reach behind it; a projection from the lamp would divide by nothing there.",
        points: &[16.0, 8.0, 4.0, 2.0, 1.5, 1.1, 1.01, 1.001, 1.000_001, 1.0],
        make: |x| {
            let at = |y: f64, z: f64| DVec3::new(-RADIUS * x, y, z);
            let parts = floor().quad("sheet", [at(0.8, -0.6), at(0.9, 0.6), at(2.9, 0.5), at(3.1, -0.5)]);
            Setup::new(parts, DVec3::new(0.0, 2.0, 0.03), RADIUS)
        },
    },
    Family {
        id: "needle",
        title: "Silhouettes inside the lamp",
        axis: "distance of the tip, radii",
        varied: "The tip of an upright triangle comes to the middle of the lamp from below; below 1 it is in the lamp.",
        meaning: "Two edges of the triangle then end inside of the lamp, with some of the lamp on every side of them.",
        points: &[4.0, 2.0, 1.1, 1.0, 0.9, 0.5, 0.1, 1e-2, 1e-4, 1e-6, 0.0],
        make: |x| {
            let lamp = DVec3::new(0.1, 2.0, 0.03);
            let tip = lamp + DVec3::new(0.36, -0.8, 0.48) * (RADIUS * x);
            let corners = [tip, DVec3::new(0.3, 0.8, -0.5), DVec3::new(-0.2, 0.9, 0.6)];
            Setup::new(floor().with("needle", &corners, &[[0, 1, 2]]), lamp, RADIUS)
        },
    },
    Family {
        id: "disc",
        title: "Edges around a disc",
        axis: "edges",
        varied: "A round sheet is made of ever more triangles; from some hundred on, its shadow must stay what it is.",
        meaning: "Each edge adds a term with a sign; errors of tens of thousands of terms must not pile up.",
        points: &[4.0, 16.0, 64.0, 256.0, 1024.0, 4096.0, 16_384.0, 65_536.0],
        make: |x| {
            let parts = floor().disc("disc", DVec3::new(0.1, 1.2, 0.0), 0.7, x as u32);
            Setup::new(parts, LAMP, RADIUS)
        },
    },
    Family {
        id: "sliver",
        title: "Slivers and triangles without area",
        axis: "width, sizes of the sheet",
        varied: "A sheet has a strip across it and a triangle along its border, both ever thinner, down to no area.",
        meaning: "Models are full of triangles with no width; they must neither shadow nor tear their neighbors apart.",
        points: &[0.3, 0.1, 1e-2, 1e-3, 1e-4, 1e-5, 1e-6, 1e-8, 1e-10, 1e-12, 1e-15, 0.0],
        make: |x| {
            let at = |s: f64, t: f64| {
                turned(DVec3::new(1.2 * s - 0.6, 0.0, 1.2 * t - 0.6)) + DVec3::new(0.1, 1.2, 0.0)
            };
            let columns = [0.0, 0.4, 0.4 + x, 1.0];
            let corners: Vec<DVec3> =
                columns.iter().flat_map(|s| [at(*s, 0.0), at(*s, 1.0)]).chain([at(0.2, -x)]).collect();
            let fields = [0, 2, 4].map(|a| [[a, a + 1, a + 3], [a, a + 3, a + 2]]);
            let triangles: Vec<[u32; 3]> = fields.into_iter().flatten().chain([[0, 2, 8]]).collect();
            Setup::new(floor().with("sheet", &corners, &triangles), LAMP, RADIUS)
        },
    },
    Family {
        id: "t-junction",
        title: "T-junctions",
        axis: "corners along the seam",
        varied: "Two halves of a slanted sheet meet at a seam that only one of them has corners on.",
        meaning: "The edges of both halves are borders of their own and lie along one another; light must not leak between.",
        points: &[0.0, 1.0, 3.0, 7.0, 15.0, 63.0, 255.0, 1023.0],
        make: |x| Setup::new(floor().seam(DVec3::new(0.1, 1.2, 0.0), x as u32), LAMP, RADIUS),
    },
    Family {
        id: "image",
        title: "Size of the picture",
        axis: "pixels of a side",
        varied: "The picture goes from one pixel to 8192 by 8192; the largest sees the scene from afar, so that most is empty.",
        meaning: "One receiver leaves nothing to share out; many must fit into the arrays of the program.",
        points: &[1.0, 2.0, 3.0, 17.0, 128.0, 1024.0, 8192.0],
        make: |x| {
            let mut setup = plain_setup();
            setup.image = ImageSize { width: x as u32, height: x as u32 };
            if x > 1024.0 {
                setup.camera.eye *= 16.0;
            }
            setup
        },
    },
    Family {
        id: "triangles",
        title: "Number of triangles",
        axis: "triangles, about",
        varied: "One triangle alone, then a wavy sheet over a floor, of ever more triangles.",
        meaning: "One triangle has nothing to shade; of two millions each is smaller than what a pixel sees.",
        points: &[1.0, 20.0, 202.0, 2050.0, 20_002.0, 200_002.0, 2_000_002.0],
        make: |x| {
            if x < 2.0 {
                let corners =
                    [DVec3::new(-1.0, 0.0, -1.0), DVec3::new(-0.2, 0.1, 1.2), DVec3::new(1.3, 0.2, 0.1)];
                return Setup::new(Parts::default().with("triangle", &corners, &[[0, 1, 2]]), LAMP, RADIUS);
            }
            let sides = ((x - 2.0) / 2.0).sqrt().round() as u32;
            Setup::new(floor().waves("sheet", DVec3::new(0.1, 1.1, 0.0), 0.7, sides), LAMP, RADIUS)
        },
    },
];
