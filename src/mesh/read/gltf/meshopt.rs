//! Buffer views compressed by meshoptimizer (glTF extension EXT_meshopt_compression).

use super::document::MeshoptView;

/// Bytes that a byte of a compressed vertex stream stands for, at most: a group of 16 values of a byte plane in a bit pair each, all alike; and
/// triangles of a byte each.
const MAX_EXPANSION: usize = 64 * 256;

/// Decodes a view; `charge` is given the bytes that it will have before they are allocated.
pub(super) fn decode(
    view: &MeshoptView,
    encoded: &[u8],
    charge: impl Fn(u64) -> Result<(), String>,
) -> Result<Vec<u8>, String> {
    let bytes = view.count.checked_mul(view.stride).ok_or("its size is no number")?;
    if bytes > encoded.len().saturating_mul(MAX_EXPANSION) {
        return Err(format!("{bytes} bytes can't come of {}", encoded.len()));
    }
    // Values, and the list that the decoder makes of them.
    charge(2 * bytes as u64)?;
    let damaged = |e: meshopt::Error| format!("damaged: {e}");
    match (&view.mode[..], &view.filter[..]) {
        ("ATTRIBUTES", filter) => attributes(view, encoded, filter),
        ("TRIANGLES" | "INDICES", "NONE") if ![2, 4].contains(&view.stride) => {
            Err(format!("indices of {} bytes", view.stride))
        }
        ("TRIANGLES", "NONE") if !view.count.is_multiple_of(3) => Err(format!("triangles of {} corners", view.count)),
        ("TRIANGLES", "NONE") => {
            let corners = meshopt::decode_index_buffer::<u32>(encoded, view.count).map_err(damaged)?;
            Ok(indices(&corners, view.stride))
        }
        ("INDICES", "NONE") => {
            let corners = meshopt::decode_index_sequence::<u32>(encoded, view.count).map_err(damaged)?;
            Ok(indices(&corners, view.stride))
        }
        (mode, filter) => Err(format!("mode {mode} with filter {filter} is not known")),
    }
}

fn indices(corners: &[u32], stride: usize) -> Vec<u8> {
    corners.iter().flat_map(|corner| corner.to_le_bytes().into_iter().take(stride)).collect()
}

/// Vertices of 4 to 256 bytes; those that hold positions have up to 16, and few views of other attributes more than 64.
fn attributes(view: &MeshoptView, encoded: &[u8], filter: &str) -> Result<Vec<u8>, String> {
    fn plain<const STRIDE: usize>(encoded: &[u8], count: usize) -> Result<Vec<u8>, String> {
        #[derive(Clone, Copy)]
        struct Vertex<const STRIDE: usize>([u8; STRIDE]);
        impl<const STRIDE: usize> Default for Vertex<STRIDE> {
            fn default() -> Self {
                Vertex([0; STRIDE])
            }
        }
        let vertices = meshopt::decode_vertex_buffer::<Vertex<STRIDE>>(encoded, count);
        Ok(vertices.map_err(|e| format!("damaged: {e}"))?.iter().flat_map(|vertex| vertex.0).collect())
    }
    macro_rules! by_stride {
        ($($stride:literal)*) => {
            match view.stride {
                $($stride => plain::<$stride>(encoded, view.count)?,)*
                other => return Err(format!("vertices of {other} bytes; 4, 8, ..., 64 are read")),
            }
        };
    }
    let mut bytes = by_stride!(4 8 12 16 20 24 28 32 36 40 44 48 52 56 60 64);
    match filter {
        "NONE" => {}
        // Shared or own exponents: 8 bits of exponent above 24 of mantissa.
        "EXPONENTIAL" => {
            for four in bytes.as_chunks_mut::<4>().0 {
                let value = i32::from_le_bytes(*four);
                let (exponent, mantissa) = (value >> 24, (value << 8) >> 8);
                *four = ((f64::from(exponent).exp2() * f64::from(mantissa)) as f32).to_le_bytes();
            }
        }
        // Of normals, tangents and rotations, which are not used.
        "OCTAHEDRAL" | "QUATERNION" | "COLOR" => {}
        other => return Err(format!("filter {other} is not known")),
    }
    Ok(bytes)
}
