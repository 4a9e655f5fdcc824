//! [`placed`]: the meshes of a scene, each with the transform of its node.

use crate::limits::ImportBudget;
use crate::similarity::{Similarity, matrix, product};

use super::document::{Document, Node};

/// Largest relative difference between the sides of a node's axes, and cosine between two of them, that count as none.
const TOLERANCE: f64 = 1e-3;

/// A matrix of three rows and four columns.
type Affine = [[f64; 4]; 3];

/// Most bytes of memory for a node: its transform in the scene and its place, in vectors that have just grown.
const BYTES_PER_PLACE: u64 = 3 * (size_of::<(usize, Affine)>() + size_of::<(usize, Similarity)>()) as u64;

const IDENTITY: Affine = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

/// The meshes of the scene, by the numbers of `document.meshes`; without a scene, of all nodes that are no children, and
/// without nodes all meshes.
///
/// # Errors
/// One sentence that names the scene or the node by its number: a number that is out of range, a node with two parents, a
/// transform that Gaussians with view-dependent colours cannot follow. As [`ImportBudget::spend`] has them.
pub(super) fn placed(
    document: &Document,
    budget: &mut ImportBudget,
) -> Result<Vec<(usize, Similarity)>, String> {
    let places = document.nodes.len().max(document.meshes.len()) as u64;
    budget.spend(places.saturating_mul(BYTES_PER_PLACE))?;
    if document.nodes.is_empty() {
        return Ok((0..document.meshes.len()).map(|mesh| (mesh, Similarity::IDENTITY)).collect());
    }
    let scene = document.scenes.get(document.scene.unwrap_or(0));
    if let Some(number) = document.scene.filter(|_| scene.is_none()) {
        return Err(format!("glTF: there is no scene {number}"));
    }
    let mut is_child = vec![false; document.nodes.len()];
    for &child in document.nodes.iter().flat_map(|node| &node.children) {
        let Some(seen) = is_child.get_mut(child) else {
            return Err(format!("glTF: there is no node {child}"));
        };
        if std::mem::replace(seen, true) {
            return Err(format!("glTF: node {child} has two parents"));
        }
    }
    let roots: Vec<usize> = match scene {
        Some(scene) => scene.nodes.clone(),
        None => (0..document.nodes.len()).filter(|&node| !is_child[node]).collect(),
    };
    let mut visited = vec![false; document.nodes.len()];
    let mut open: Vec<(usize, Affine)> = roots.into_iter().rev().map(|root| (root, IDENTITY)).collect();
    let mut placed = Vec::new();
    while let Some((number, parent)) = open.pop() {
        let node = document.nodes.get(number).ok_or_else(|| format!("glTF: there is no node {number}"))?;
        if std::mem::replace(&mut visited[number], true) {
            return Err(format!("glTF: node {number} is in the scene twice"));
        }
        let world = chained(&parent, &local(node));
        if let Some(mesh) = node.mesh {
            if mesh >= document.meshes.len() {
                return Err(format!("glTF: there is no mesh {mesh}"));
            }
            placed.push((mesh, similarity(&world).ok_or_else(|| unlike(number))?));
        }
        open.extend(node.children.iter().rev().map(|&child| (child, world)));
    }
    Ok(placed)
}

fn unlike(number: usize) -> String {
    format!(
        "glTF: node {number} is scaled unequally, sheared, mirrored or not finite, which Gaussians do not follow; apply \
         its transform in the program that wrote the file"
    )
}

/// The transform of a node in its parent.
fn local(node: &Node) -> Affine {
    if let Some(columns) = &node.matrix {
        return [0, 1, 2].map(|row| [0, 1, 2, 3].map(|column| columns[4 * column + row]));
    }
    let [x, y, z, w] = node.rotation.as_deref().copied().unwrap_or([0.0, 0.0, 0.0, 1.0]);
    let turn = matrix([w, x, y, z]);
    let scale = node.scale.as_deref().copied().unwrap_or([1.0; 3]);
    let translation = node.translation.as_deref().copied().unwrap_or_default();
    [0, 1, 2].map(|row| {
        let [a, b, c] = [0, 1, 2].map(|column| turn[row][column] * scale[column]);
        [a, b, c, translation[row]]
    })
}

fn chained(a: &Affine, b: &Affine) -> Affine {
    [0, 1, 2].map(|row| {
        let mut entries = [0, 1, 2, 3].map(|column| (0..3).map(|k| a[row][k] * b[k][column]).sum::<f64>());
        entries[3] += a[row][3];
        entries
    })
}

/// An affine map as a similarity; `None` if it is none.
fn similarity(map: &Affine) -> Option<Similarity> {
    if *map == IDENTITY {
        return Some(Similarity::IDENTITY);
    }
    let column = |k: usize| [0, 1, 2].map(|row| map[row][k]);
    let dot = |a: [f64; 3], b: [f64; 3]| (0..3).map(|k| a[k] * b[k]).sum::<f64>();
    let [a, b, c] = [0, 1, 2].map(column);
    let scale = dot(a, a).sqrt();
    let is_near = |x: f64, y: f64| (x - y).abs() <= TOLERANCE * scale * scale;
    let has_equal_sides = is_near(dot(b, b), scale * scale) && is_near(dot(c, c), scale * scale);
    let is_square = is_near(dot(a, b), 0.0) && is_near(dot(a, c), 0.0) && is_near(dot(b, c), 0.0);
    let cross = [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
    let translation = column(3);
    let is_finite = scale > 0.0 && scale.is_finite() && translation.iter().all(|x| x.is_finite());
    if !(is_finite && has_equal_sides && is_square && dot(cross, c) > 0.0) {
        return None;
    }
    let m = |row: usize, k: usize| map[row][k] / scale;
    Some(Similarity { rotation: quaternion(m), scale, translation })
}

/// The unit quaternion w, x, y, z of a rotation, by the largest of its components.
fn quaternion(m: impl Fn(usize, usize) -> f64) -> [f64; 4] {
    let squares = [
        1.0 + m(0, 0) + m(1, 1) + m(2, 2),
        1.0 + m(0, 0) - m(1, 1) - m(2, 2),
        1.0 - m(0, 0) + m(1, 1) - m(2, 2),
        1.0 - m(0, 0) - m(1, 1) + m(2, 2),
    ];
    let largest = (1..4).fold(0, |best, k| if squares[k] > squares[best] { k } else { best });
    let q = match largest {
        0 => [squares[0], m(2, 1) - m(1, 2), m(0, 2) - m(2, 0), m(1, 0) - m(0, 1)],
        1 => [m(2, 1) - m(1, 2), squares[1], m(0, 1) + m(1, 0), m(0, 2) + m(2, 0)],
        2 => [m(0, 2) - m(2, 0), m(0, 1) + m(1, 0), squares[2], m(1, 2) + m(2, 1)],
        _ => [m(1, 0) - m(0, 1), m(0, 2) + m(2, 0), m(1, 2) + m(2, 1), squares[3]],
    };
    let norm = product(q, [q[0], -q[1], -q[2], -q[3]])[0].sqrt();
    q.map(|x| x / norm)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::limits::ImportLimits;

    fn document(nodes: serde_json::Value) -> Document {
        let all = serde_json::json!({"nodes": nodes, "meshes": [{"primitives": []}]});
        serde_json::from_value(all).unwrap()
    }

    fn placed(document: Document) -> Result<Vec<(usize, Similarity)>, String> {
        super::placed(&document, &mut ImportBudget::new(ImportLimits::default()))
    }

    #[test]
    fn transforms_are_chained_from_the_root() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let nodes = serde_json::json!([
            {"children": [1], "translation": [1, 0, 0], "rotation": [0, 0, half, half]},
            {"mesh": 0, "scale": [2, 2, 2], "translation": [3, 0, 0]},
        ]);
        let [(0, place)] = placed(document(nodes)).unwrap()[..] else { panic!("one mesh") };
        let near = |a: &[f64], b: &[f64]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
        assert!(near(&place.translation, &[1.0, 3.0, 0.0]), "{place:?}");
        assert!(
            near(&place.rotation, &[half, 0.0, 0.0, half]) && (place.scale - 2.0).abs() < 1e-9,
            "{place:?}"
        );
        let turned =
            serde_json::json!([{"mesh": 0, "matrix": [1, 0, 0, 0, 0, -1, 0, 0, 0, 0, -1, 0, 4, 5, 6, 1]}]);
        let [(0, place)] = placed(document(turned)).unwrap()[..] else { panic!("one mesh") };
        assert_eq!((place.rotation, place.translation), ([0.0, 1.0, 0.0, 0.0], [4.0, 5.0, 6.0]));
    }

    #[test]
    fn what_gaussians_do_not_follow_is_refused() {
        for (nodes, text) in [
            (serde_json::json!([{"mesh": 0, "scale": [1, 2, 1]}]), "scaled unequally"),
            (serde_json::json!([{"mesh": 0, "scale": [-1, 1, 1]}]), "mirrored"),
            (serde_json::json!([{"mesh": 0, "scale": [0, 0, 0]}]), "node 0"),
            (serde_json::json!([{"mesh": 0, "scale": [1e300, 1e300, 1e300]}]), "not finite"),
            (serde_json::json!([{"mesh": 1}]), "no mesh 1"),
            (serde_json::json!([{"children": [4]}]), "no node 4"),
            (serde_json::json!([{"children": [1]}, {"children": [1]}]), "two parents"),
        ] {
            let error = placed(document(nodes)).unwrap_err();
            assert!(error.contains(text), "{error}");
        }
        let mut cycle = document(serde_json::json!([{"children": [1]}, {"children": [0]}]));
        cycle.scenes = serde_json::from_value(serde_json::json!([{"nodes": [0]}])).unwrap();
        assert!(placed(cycle).unwrap_err().contains("twice"));
        let mut other = document(serde_json::json!([{"mesh": 0}]));
        other.scene = Some(3);
        assert_eq!(placed(other).unwrap_err(), "glTF: there is no scene 3");
    }
}
