//! What is one object: all that hangs together over edges.

/// The object that each of `triangles` triangles belongs to, numbered by first triangle. `rows` are the faces on each edge, see
/// [`Adjacency::edge_faces`](super::Adjacency::edge_faces).
///
/// An edge belongs to one object, however many faces are on it: bodies that share an edge are one object, and a triangle that
/// is on no edge is one by itself.
#[must_use]
pub fn objects<'a>(triangles: usize, rows: impl Iterator<Item = &'a [u32]>) -> Vec<u32> {
    // A forest, each root the first triangle of its tree.
    let mut parent: Vec<u32> = (0..triangles as u32).collect();
    for row in rows {
        let Some((first, others)) = row.split_first() else { continue };
        for other in others {
            let (a, b) = (root(&mut parent, first >> 1), root(&mut parent, other >> 1));
            parent[a.max(b) as usize] = a.min(b);
        }
    }
    let mut numbers = Vec::with_capacity(triangles);
    let mut count = 0;
    for t in 0..triangles as u32 {
        let root = root(&mut parent, t);
        let number = if root == t { count } else { numbers[root as usize] };
        count += u32::from(root == t);
        numbers.push(number);
    }
    numbers
}

/// The root of triangle `t`; halves the way to it.
fn root(parent: &mut [u32], mut t: u32) -> u32 {
    while parent[t as usize] != t {
        let next = parent[parent[t as usize] as usize];
        parent[t as usize] = next;
        t = next;
    }
    t
}

#[cfg(test)]
mod tests {
    use super::objects;

    #[test]
    fn what_hangs_together_over_edges_is_one_object_and_the_first_triangle_orders_them() {
        // 0 - 3 - 5 over edges of two faces, 1 and 2 and 4 over one of three, 6 alone.
        let rows: [&[u32]; 5] = [&[6, 11], &[0, 7], &[2, 4, 9], &[12], &[]];
        assert_eq!(objects(7, rows.into_iter()), [0, 1, 1, 0, 1, 0, 2]);
        assert!(objects(0, core::iter::empty()).is_empty());
    }
}
