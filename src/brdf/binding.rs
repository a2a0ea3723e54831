//! Which triangles take which material, and section `bIND` that says so. Specified in `spec/materials.md`.

use super::materials::NamedMaterial;
use crate::container::Tag;
#[cfg(feature = "encode")]
use crate::container::push_u16;
use crate::entropy::{BitCoder, BitModel, NumberModel, RangeDecoder, code_end};
use crate::error::{Error, Result};
use crate::limits::Budget;
use byteorder::{ByteOrder, LittleEndian};
use std::collections::HashSet;

/// First byte of the section. Part of the format.
const VERSION: u8 = 0;

/// Materials of a mesh's triangles, by name.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct TriangleBinding {
    /// Names of materials that the file holds, each once.
    pub names: Vec<String>,
    /// For each triangle of the mesh the place of its material among `names`, counted from 1; 0 for one that takes none and is drawn by
    /// what else the file has of it.
    pub of_triangle: Vec<u16>,
}

impl TriangleBinding {
    /// Binds all triangles to one material.
    pub fn whole(name: impl Into<String>, triangles: usize) -> Self {
        TriangleBinding { names: vec![name.into()], of_triangle: vec![1; triangles] }
    }

    /// Returns the place of a triangle's material among the names.
    pub fn material_of(&self, triangle: usize) -> Option<usize> {
        let number = self.of_triangle.get(triangle).copied().unwrap_or(0);
        usize::from(number).checked_sub(1).filter(|&place| place < self.names.len())
    }

    /// Returns the number of triangles that take each material.
    pub fn counts(&self) -> Vec<usize> {
        let mut counts = vec![0; self.names.len()];
        for material in (0..self.of_triangle.len()).filter_map(|triangle| self.material_of(triangle)) {
            counts[material] += 1;
        }
        counts
    }
}

/// Adaptive models of the triangles' materials.
#[derive(Default)]
struct BindingModels {
    /// Whether a triangle is bound as the one before, by whether that one was.
    as_before: [BitModel; 2],
    number: NumberModel,
}

/// Codes the materials of all triangles, each below `count`; `false` where one is not.
fn code<C: BitCoder>(coder: &mut C, of_triangle: &mut [u16], count: u32) -> bool {
    let mut models = BindingModels::default();
    let (mut before, mut repeats) = (1, true);
    for bound in of_triangle {
        let number = u32::from(*bound);
        repeats = models.as_before[usize::from(repeats)].code(coder, number == before);
        if !repeats {
            // One of the others.
            let other = models.number.code(coder, if number > before { number - 1 } else { number });
            before = if other >= before { other.saturating_add(1) } else { other };
            if before >= count {
                return false;
            }
        }
        *bound = before as u16;
    }
    code_end(coder)
}

/// Section `bIND` of a mesh's triangles in the order of its section.
/// # Errors
/// [`Error::Parameter`] where a name is empty, longer than 255 bytes or there twice, there are none or more than 65535, or a triangle names
/// one that there is not.
#[cfg(feature = "encode")]
pub fn encode_binding(binding: &TriangleBinding) -> Result<Vec<u8>> {
    let TriangleBinding { names, of_triangle } = binding;
    let count = match u16::try_from(names.len()) {
        Ok(count) if count > 0 && of_triangle.iter().all(|&bound| bound <= count) => count,
        _ => return Err(Error::parameter("triangles are bound to one of 1 to 65535 materials, or to none")),
    };
    let mut bytes = vec![VERSION];
    push_u16(&mut bytes, count);
    let mut known = HashSet::new();
    for name in names {
        let length = u8::try_from(name.len()).ok().filter(|&length| length > 0 && known.insert(name));
        let Some(length) = length else {
            return Err(Error::parameter(format!("material '{name}': a name has 1 to 255 bytes and is there once")));
        };
        bytes.push(length);
        bytes.extend_from_slice(name.as_bytes());
    }
    let mut coder = crate::entropy::RangeEncoder::new();
    code(&mut coder, &mut of_triangle.clone(), u32::from(count) + 1);
    bytes.extend(coder.finish());
    Ok(bytes)
}

/// Reads section `bIND` of a mesh of so many triangles and of the file's materials.
/// # Errors
/// [`Error::Format`] where the section breaks a rule of `spec/materials.md`, such as naming a material that the file does not hold;
/// [`Error::Unsupported`] for another version; [`Error::Limits`] where the budget ends.
pub fn decode_binding(
    bytes: &[u8],
    triangles: usize,
    materials: &[NamedMaterial],
    budget: &Budget,
) -> Result<TriangleBinding> {
    let wrong = |at: usize, message: String| Error::format(Tag::BINDING, at as u64, message);
    match bytes.first() {
        Some(&VERSION) => {}
        Some(version) => {
            let message = format!("version {version} of section {}; this build reads {VERSION}", Tag::BINDING);
            return Err(Error::Unsupported(message));
        }
        None => return Err(wrong(0, "empty".into())),
    }
    let count = bytes.get(1..3).map_or(0, LittleEndian::read_u16);
    if count == 0 {
        return Err(wrong(1, "triangles are bound to at least one material".into()));
    }
    let held: HashSet<&str> = materials.iter().map(|named| named.name.as_str()).collect();
    let mut names: Vec<String> = Vec::new();
    let (mut known, mut at) = (HashSet::new(), 3);
    for _ in 0..count {
        let name = bytes.get(at).and_then(|&length| bytes.get(at + 1..at + 1 + usize::from(length)));
        let name = name.and_then(|name| std::str::from_utf8(name).ok()).filter(|name| !name.is_empty());
        let name = name.ok_or_else(|| wrong(at, "a name is 1 to 255 bytes of UTF-8".into()))?;
        if !held.contains(name) {
            return Err(wrong(at, format!("triangles are bound to material '{name}', which the file does not hold")));
        }
        if !known.insert(name) {
            return Err(wrong(at, format!("material '{name}' is named twice")));
        }
        budget.charge("names of bound materials", name.len() as u64 + 64)?;
        names.push(name.to_owned());
        at += 1 + name.len();
    }
    budget.charge_items("bound triangles", triangles as u64, size_of::<u16>())?;
    let mut of_triangle = vec![0; triangles];
    let mut coder = RangeDecoder::new(&bytes[at..]);
    if !code(&mut coder, &mut of_triangle, u32::from(count) + 1) || !coder.ends_as_written(0) {
        return Err(wrong(at, "the triangles' materials are damaged, or those of another mesh".into()));
    }
    Ok(TriangleBinding { names, of_triangle })
}

#[cfg(all(test, feature = "encode"))]
mod tests {
    use super::*;
    use crate::Limits;
    use crate::brdf::{ClassicalLobe, ClassicalModel, FittedMaterial};

    fn materials(names: &[&str]) -> Vec<NamedMaterial> {
        let model = ClassicalModel { diffuse: [0.5; 3], specular: [0.0; 3], lobe: ClassicalLobe::Lambert };
        let named =
            |name: &&str| NamedMaterial { name: name.to_string(), material: FittedMaterial::Classical(model.clone()) };
        names.iter().map(named).collect()
    }

    #[test]
    fn bindings_come_back_and_damage_is_found() {
        let budget = || Budget::new(Limits::default());
        let held = materials(&["gold", "felt \u{8276}", "not bound"]);
        let of_triangle: Vec<u16> = (0..1000).map(|k: u32| [1, 1, 2, 0][(k / 97) as usize % 4]).collect();
        let binding = TriangleBinding { names: vec![held[1].name.clone(), "gold".into()], of_triangle };
        let bytes = encode_binding(&binding).unwrap();
        assert!(bytes.len() < 60, "{} bytes", bytes.len());
        assert_eq!(decode_binding(&bytes, 1000, &held, &budget()).unwrap(), binding);
        assert_eq!(binding.counts(), [582, 224]);
        let refused = |bytes: &[u8], triangles: usize, held: &[NamedMaterial]| {
            matches!(decode_binding(bytes, triangles, held, &budget()), Err(Error::Format { .. }))
        };
        for cut in 0..bytes.len() {
            assert!(refused(&bytes[..cut], 1000, &held), "cut at {cut}");
        }
        assert!(refused(&[&bytes[..], &[0]].concat(), 1000, &held));
        // Another mesh, materials that the file has not, the same name twice, no name, another version.
        assert!(refused(&bytes, 500, &held) && refused(&bytes, 1000, &held[..1]));
        let twice = [&[0, 2, 0, 4], &b"gold"[..], &[4], &b"gold"[..], &[0, 0]].concat();
        assert!(refused(&twice, 0, &held) && refused(&[0, 0, 0, 0], 0, &held));
        assert!(matches!(decode_binding(&[7, 1, 0], 1, &held, &budget()), Err(Error::Unsupported(_))));
        let little = Budget::new(Limits { memory_bytes: 1000, ..Limits::default() });
        assert!(matches!(decode_binding(&bytes, 1000, &held, &little), Err(Error::Limits { .. })));
        // What can't be written is not.
        for wrong in [
            TriangleBinding { names: vec![], of_triangle: vec![0] },
            TriangleBinding { names: vec!["a".into(), "a".into()], of_triangle: vec![1] },
            TriangleBinding { names: vec!["a".into()], of_triangle: vec![2] },
            TriangleBinding { names: vec![String::new()], of_triangle: vec![1] },
        ] {
            assert!(matches!(encode_binding(&wrong), Err(Error::Parameter(_))));
        }
        // A mesh of one material costs a few bytes.
        assert!(encode_binding(&TriangleBinding::whole("gold", 100_000)).unwrap().len() < 30);
    }
}
