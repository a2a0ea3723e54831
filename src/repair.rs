//! Repair: from a damaged file to a whole one with all that checksums still prove.
//!
//! [`repair`] looks for sections ([`crate::container::survey`]) and, in section PLAN, for views ([`crate::predictive::repair`]). What needs
//! something that is lost is lost with it; sections that a reader requires are added, empty.

use crate::container::metadata::{self, Metadata};
use crate::container::survey::{Survey, survey, without_carriage_returns};
use crate::container::{ContainerWriter, Section, SectionCodec, SectionRule, Tag, section_rules, verify};
use crate::error::{Error, FilePart, Result};
use crate::limits::{Budget, Limits};
use crate::mesh::Mesh;
use crate::predictive::header::PlaneHeader;
use crate::views::Component;
use crate::views::codec;
use crate::views::codec::ViewsSection;
use crate::{mesh, predictive};
use serde_json::{Map, json};
use std::borrow::Cow;

/// A repaired file.
#[derive(Debug, Clone, PartialEq)]
pub struct RepairedFile {
    /// The whole file; the given one if it was undamaged.
    pub bytes: Vec<u8>,
    /// Faults besides those of sections and views, one sentence each.
    pub faults: Vec<String>,
    /// Sections that the file keeps.
    pub kept: Vec<Tag>,
    /// Sections that are lost, and why.
    pub lost_sections: Vec<(Tag, String)>,
    /// Number of the file's views.
    pub views: usize,
    /// Views whose photographs are lost: number, name, and why.
    pub lost_views: Vec<(usize, String, String)>,
    /// Whether all sections of the damaged file are known: not where it ends early and its directory is missing.
    pub is_all_known: bool,
    /// Whether the given file was undamaged.
    pub was_whole: bool,
}

impl RepairedFile {
    /// Whether anything is lost.
    pub fn has_losses(&self) -> bool {
        !self.is_all_known || !self.lost_sections.is_empty() || !self.lost_views.is_empty()
    }
}

/// Sections of which a file needs one to be of any use.
const CONTENT: [Tag; 4] = [Tag::MESH, Tag::VIEWS, Tag::MATERIALS, Tag::LIGHT];
/// What photographs need that are predicted from the reflectance.
const MODEL: [Tag; 3] = [Tag::CHARTS, Tag::DISPLACEMENT, Tag::REFLECTANCE];
const DAMAGED_SECTION: &str = "its checksum does not match, or it is cut";

/// Repairs a damaged file.
/// # Errors
/// [`Error::Format`] where nothing is left that can be used, [`Error::Unsupported`] for files of other versions,
/// [`Error::Limits`] where what is left asks for more than it may.
pub fn repair(bytes: &[u8], limits: Limits) -> Result<RepairedFile> {
    if let Ok(sections) = verify(bytes, limits) {
        let kept = sections.iter().map(|section| section.tag).collect();
        let (faults, lost_sections, lost_views) = Default::default();
        let views = views_of(bytes, &sections, &Budget::new(limits)).map_or(0, |section| section.views.len());
        let bytes = bytes.to_vec();
        return Ok(RepairedFile {
            bytes,
            faults,
            kept,
            lost_sections,
            views,
            lost_views,
            is_all_known: true,
            was_whole: true,
        });
    }
    let mut faults = Vec::new();
    let mut bytes = Cow::Borrowed(bytes);
    if let Some(undone) = without_carriage_returns(&bytes) {
        faults.push("a transfer in text mode had put a carriage return before every line feed".to_owned());
        bytes = Cow::Owned(undone);
    }
    let survey = survey(&bytes)?;
    faults.extend(survey.faults.iter().cloned());
    let budget = Budget::new(limits);
    let mut work = FileRepair {
        bytes: &bytes,
        survey: &survey,
        budget: &budget,
        lost_sections: Vec::new(),
        lost_views: Vec::new(),
    };
    let mut repaired = work.repaired_file()?;
    repaired.faults = faults;
    Ok(repaired)
}

fn views_of(bytes: &[u8], sections: &[Section], budget: &Budget) -> Option<ViewsSection> {
    let section = sections.iter().find(|section| section.tag == Tag::VIEWS)?;
    let start = (section.offset + section.header_bytes()) as usize;
    codec::decode(bytes.get(start..start + section.stored as usize)?, budget).ok()
}

struct FileRepair<'a> {
    bytes: &'a [u8],
    survey: &'a Survey,
    budget: &'a Budget,
    lost_sections: Vec<(Tag, String)>,
    lost_views: Vec<(usize, String, String)>,
}

impl FileRepair<'_> {
    fn repaired_file(&mut self) -> Result<RepairedFile> {
        let mut sections: Vec<(Tag, SectionCodec, Vec<u8>)> = Vec::new();
        for whole in &self.survey.whole {
            let (section, stored) = (whole.section, whole.bytes(self.bytes));
            self.budget.charge("section", section.stored)?;
            sections.push((section.tag, section.codec, section.decode(stored.to_vec(), self.budget)?));
        }
        for (section, _) in &self.survey.damaged {
            self.lost_sections.push((section.tag, DAMAGED_SECTION.into()));
        }
        if !sections.iter().any(|(tag, ..)| CONTENT.contains(tag)) {
            let reason = self.survey.faults.first().map_or("no section that can be used is whole", String::as_str);
            return Err(Error::format(
                FilePart::File,
                0u8,
                format!("nothing can be saved: no mesh, views, materials or light is whole ({reason})"),
            ));
        }
        let section = self.section(&sections)?;
        let mesh = match sections.iter().find(|(tag, ..)| *tag == Tag::MESH) {
            Some((_, _, content)) => Some(mesh::codec::decode(content, self.budget)?),
            None => None,
        };
        if let (Some(mesh), Some(section)) = (&mesh, &section) {
            self.planes(&mut sections, mesh, section)?;
        }
        self.drop_what_needs_others(&mut sections);
        let photographs = sections.iter().any(|(tag, ..)| [Tag::PLANES, Tag::WAVELET_TEXTURE].contains(tag));
        if let Some(section) = section.as_ref().filter(|_| !photographs && self.had_photographs()) {
            let lost = |(index, view): (usize, &crate::views::View)| {
                (index, view.name.clone(), "its section is lost".to_owned())
            };
            self.lost_views = section.views.iter().enumerate().map(lost).collect();
        }
        let kept = sections.iter().map(|(tag, ..)| *tag).collect();
        self.stand_ins(&mut sections)?;
        self.describe(&mut sections)?;
        let mut writer = ContainerWriter::new(Vec::with_capacity(self.bytes.len()))?;
        for (tag, codec, content) in &sections {
            writer.write_section(*tag, *codec, content)?;
        }
        Ok(RepairedFile {
            bytes: writer.finish()?,
            faults: Vec::new(),
            kept,
            lost_sections: std::mem::take(&mut self.lost_sections),
            views: section.map_or(0, |section| section.views.len()),
            lost_views: std::mem::take(&mut self.lost_views),
            is_all_known: self.survey.is_all_known,
            was_whole: false,
        })
    }

    fn section(&self, sections: &[(Tag, SectionCodec, Vec<u8>)]) -> Result<Option<ViewsSection>> {
        let found = sections.iter().find(|(tag, ..)| *tag == Tag::VIEWS);
        found.map(|(_, _, content)| codec::decode(content, self.budget)).transpose()
    }

    /// The views of a section PLAN that is not whole.
    fn planes(
        &mut self,
        sections: &mut Vec<(Tag, SectionCodec, Vec<u8>)>,
        mesh: &Mesh,
        views: &ViewsSection,
    ) -> Result<()> {
        let has = |wanted: Tag| sections.iter().any(|(tag, ..)| *tag == wanted);
        if has(Tag::PLANES) || has(Tag::WAVELET_TEXTURE) || views.views.is_empty() {
            return Ok(());
        }
        let damaged =
            self.survey.damaged.iter().find(|(section, _)| section.tag == Tag::PLANES).map(|(_, range)| range.clone());
        let is_known = damaged.is_some();
        let ranges: Vec<_> = damaged.into_iter().chain(self.survey.unexplained.iter().cloned()).collect();
        let count = views.components.len();
        let Some(start) = predictive::repair::find_head(self.bytes, &ranges, &views.views, count, self.budget) else {
            return Ok(());
        };
        // Up to the next whole section, or the directory.
        let within = ranges.iter().filter(|range| range.contains(&start)).map(|range| range.end).max();
        let end = within.unwrap_or(self.bytes.len());
        let made = predictive::repair::repair(self.bytes, (start, end), mesh, &views.views, count, self.budget)?;
        if made.lost.len() == views.views.len() {
            if !is_known {
                self.lost_sections.push((Tag::PLANES, DAMAGED_SECTION.into()));
            }
            return Ok(());
        }
        self.lost_sections.retain(|(tag, _)| *tag != Tag::PLANES);
        for (view, loss) in made.lost {
            let name = views.views[view].name.clone();
            let reason = match loss {
                predictive::repair::ViewLoss::Streams => "its bytes are damaged or missing".to_owned(),
                predictive::repair::ViewLoss::Predicted(other) => {
                    format!("it is predicted from {}, which is lost", views.views[other].name)
                }
            };
            self.lost_views.push((view, name, reason));
        }
        self.lost_views.sort();
        let after = sections
            .iter()
            .position(|(tag, ..)| *tag == Tag::REFLECTANCE)
            .or(sections.iter().position(|(tag, ..)| *tag == Tag::VIEWS));
        sections.insert(after.map_or(sections.len(), |at| at + 1), (Tag::PLANES, SectionCodec::Own, made.bytes));
        Ok(())
    }

    fn had_photographs(&self) -> bool {
        let lost = |tag: Tag| self.lost_sections.iter().any(|(other, _)| *other == tag);
        lost(Tag::PLANES) || lost(Tag::WAVELET_TEXTURE) || !self.survey.is_all_known
    }

    fn drop_what_needs_others(&mut self, sections: &mut Vec<(Tag, SectionCodec, Vec<u8>)>) {
        for SectionRule { tag, dependencies, .. } in section_rules() {
            let has = |wanted: &Tag| sections.iter().any(|(tag, ..)| tag == wanted);
            let of_model: &[Tag] = match sections.iter().find(|(other, ..)| *other == tag && tag == Tag::PLANES) {
                Some((_, _, content)) if PlaneHeader::is_modelled(content) => &MODEL,
                _ => &[],
            };
            let needed = &mut dependencies.iter().chain(of_model);
            if let Some(missing) = needed.find(|needed| !has(needed)).filter(|_| has(&tag)) {
                self.lost_sections.push((tag, format!("it is whole, but nothing without {missing}")));
                sections.retain(|(other, ..)| *other != tag);
            }
        }
    }

    /// Adds the section that a reader requires besides, with nothing in it.
    fn stand_ins(&self, sections: &mut Vec<(Tag, SectionCodec, Vec<u8>)>) -> Result<()> {
        let has = |wanted: Tag| sections.iter().any(|(tag, ..)| *tag == wanted);
        let (has_mesh, has_views) = (has(Tag::MESH), has(Tag::VIEWS));
        if has_mesh == has_views {
            return Ok(());
        }
        let standing = if has_mesh {
            let none = ViewsSection { white: [1.0; 3], components: vec![Component::Combined], views: Vec::new() };
            (Tag::VIEWS, SectionCodec::Own, codec::encode(&none, &[])?)
        } else {
            let options = mesh::codec::MeshOptions { position_bits: 8 };
            (Tag::MESH, SectionCodec::Own, mesh::codec::encode(&Mesh::default(), &options)?.bytes)
        };
        let beside = if has_mesh { Tag::MESH } else { Tag::VIEWS };
        let at = sections.iter().position(|(tag, ..)| *tag == beside).unwrap_or(0);
        sections.insert(at + has_mesh as usize, standing);
        Ok(())
    }

    /// Notes in the metadata that the file was repaired and what it lacks.
    fn describe(&self, sections: &mut Vec<(Tag, SectionCodec, Vec<u8>)>) -> Result<()> {
        if self.lost_sections.is_empty() && self.lost_views.is_empty() {
            return Ok(());
        }
        let position = sections.iter().position(|(tag, ..)| *tag == Tag::METADATA);
        let mut described = match position {
            Some(at) => metadata::decode(&sections.remove(at).2, self.budget)?,
            None => Metadata(Map::new()),
        };
        let tags: Vec<String> = self.lost_sections.iter().map(|(tag, _)| tag.to_string()).collect();
        // What an earlier repair lost is still lost.
        let mut views = described.lost_views();
        views.extend(self.lost_views.iter().map(|(view, ..)| *view));
        views.sort_unstable();
        views.dedup();
        let mut repaired =
            json!({"by": concat!("tsuya ", env!("CARGO_PKG_VERSION")), "lost_sections": tags, "lost_views": views});
        // The error of the whole is not that of the rest.
        if !views.is_empty()
            && let Some(error) = described.0.remove("achieved_error")
        {
            repaired["achieved_error_before"] = error;
        }
        described.0.insert("repaired".into(), repaired);
        let content = metadata::encode(&described)?;
        sections.insert(0, (Tag::METADATA, SectionCodec::Zstd, content));
        Ok(())
    }
}
