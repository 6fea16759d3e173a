//! Triangle meshes in world space.

use glam::DVec3;

/// Names and the triangles that they cover: `first..last`, half open.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ObjectRange {
    /// Name of the object as in the file; empty if the file gives none. Need not be unique.
    pub name: String,
    /// Names of the groups that the triangles belong to, with blanks between them, as in the file; mostly empty.
    pub groups: String,
    /// First triangle of the object.
    pub first: u32,
    /// One past the last triangle of the object.
    pub last: u32,
}

/// Distance from `p` to the nearest point of a triangle [Ericson 2005, §5.1.5].
pub(crate) fn distance_to_triangle(p: DVec3, [a, b, c]: [DVec3; 3]) -> f64 {
    let (ab, ac) = (b - a, c - a);
    let normal = ab.cross(ac);
    let inside = [(a, b), (b, c), (c, a)].iter().all(|&(u, v)| (v - u).cross(p - u).dot(normal) >= 0.0);
    if inside && normal != DVec3::ZERO {
        return (p - a).dot(normal.normalize()).abs();
    }
    let to_edge = |u: DVec3, v: DVec3| {
        let edge = v - u;
        let t = ((p - u).dot(edge) / edge.length_squared().max(f64::MIN_POSITIVE)).clamp(0.0, 1.0);
        (p - u - edge * t).length()
    };
    to_edge(a, b).min(to_edge(b, c)).min(to_edge(c, a))
}

impl ObjectRange {
    /// Every name that these triangles go by: the object's, each group's, and the groups' as one, since many a program
    /// writes one name with blanks in it. Empty ones are left out.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        let whole = [self.name.as_str(), self.groups.as_str()];
        whole.into_iter().filter(|name| !name.is_empty()).chain(self.groups.split_whitespace())
    }

    /// Whether the triangles go by `name`.
    #[must_use]
    pub fn is_called(&self, name: &str) -> bool {
        self.names().any(|known| known == name)
    }
}

/// Indexed triangles, f64, world space, any unit.
///
/// A mesh of a [`crate::Scene`] has been welded and oriented ([`crate::adjacency::prepare`]); one straight from a
/// file has not.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Mesh {
    /// Vertex positions; finite, and finite in f32 too.
    pub positions: Vec<DVec3>,
    /// Three indices into `positions` each. Degenerate and duplicate triangles are allowed.
    pub triangles: Vec<[u32; 3]>,
    /// Named runs of triangles, in order; together they cover all triangles.
    pub objects: Vec<ObjectRange>,
}

/// An axis-aligned box; empty when `min > max`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bounds {
    /// Corner with the least coordinates.
    pub min: DVec3,
    /// Corner with the greatest coordinates.
    pub max: DVec3,
}

impl Bounds {
    /// The box that holds nothing.
    pub const EMPTY: Self = Self { min: DVec3::INFINITY, max: DVec3::NEG_INFINITY };

    /// Grows the box to hold `point`.
    pub fn add(&mut self, point: DVec3) {
        self.min = self.min.min(point);
        self.max = self.max.max(point);
    }

    /// The smallest box that holds both.
    #[must_use]
    pub fn union(self, other: Self) -> Self {
        Self { min: self.min.min(other.min), max: self.max.max(other.max) }
    }

    /// Edge lengths of the box.
    #[must_use]
    pub fn size(&self) -> DVec3 {
        self.max - self.min
    }

    /// The middle, formed so that it does not overflow.
    #[must_use]
    pub fn center(&self) -> DVec3 {
        self.min * 0.5 + self.max * 0.5
    }

    /// Length of the diagonal; 0 for an empty box.
    #[must_use]
    pub fn diagonal(&self) -> f64 {
        let size = self.size();
        if size.x < 0.0 { 0.0 } else { length(size) }
    }
}

/// Length of `v` without overflow or underflow on the way (coordinates may be 1e30 or 1e-300).
pub(crate) fn length(v: DVec3) -> f64 {
    let scale = v.abs().max_element();
    if scale == 0.0 || !scale.is_finite() { scale } else { scale * (v / scale).length() }
}

/// Direction of a triangle's normal, of any length; zero if it has no area in f64. Its edges are scaled, so that areas
/// of 1e-60 do not count as none and those of 1e60 do not overflow.
pub(crate) fn normal_direction([a, b, c]: [DVec3; 3]) -> DVec3 {
    let (e, f) = (b - a, c - a);
    let scale = e.abs().max_element().max(f.abs().max_element());
    if scale == 0.0 { DVec3::ZERO } else { (e / scale).cross(f / scale) }
}

impl Mesh {
    /// Corners of triangle `index`.
    #[must_use]
    pub fn corners(&self, index: usize) -> [DVec3; 3] {
        self.triangles[index].map(|v| self.positions[v as usize])
    }

    /// `(b - a) x (c - a)`: normal times twice the area.
    #[must_use]
    pub fn area_normal(&self, index: usize) -> DVec3 {
        let [a, b, c] = self.corners(index);
        (b - a).cross(c - a)
    }

    /// Box around the vertices that triangles use: stray vertices do not count.
    #[must_use]
    pub fn bounds(&self) -> Bounds {
        let mut bounds = Bounds::EMPTY;
        for &v in self.triangles.iter().flatten() {
            bounds.add(self.positions[v as usize]);
        }
        bounds
    }

    /// Adds `other` behind what is here, objects included.
    pub fn append(&mut self, other: &Self) {
        let first_vertex = self.positions.len() as u32;
        let first_triangle = self.triangles.len() as u32;
        self.positions.extend_from_slice(&other.positions);
        self.triangles.extend(other.triangles.iter().map(|t| t.map(|v| v + first_vertex)));
        self.objects.extend(other.objects.iter().map(|o| ObjectRange {
            name: o.name.clone(),
            groups: o.groups.clone(),
            first: o.first + first_triangle,
            last: o.last + first_triangle,
        }));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_distance_to_a_triangle_is_to_its_inside_an_edge_or_a_corner() {
        let triangle = [DVec3::ZERO, DVec3::X, DVec3::Y];
        for (p, expected) in [([0.2, 0.2, -3.0], 3.0), ([0.5, -2.0, 0.0], 2.0), ([-3.0, -4.0, 0.0], 5.0)] {
            assert!((distance_to_triangle(p.into(), triangle) - expected).abs() < 1e-15);
        }
    }
}
