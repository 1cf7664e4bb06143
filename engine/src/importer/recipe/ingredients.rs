//! Words for the parts of concrete in German, English, French, Spanish, Portuguese and Italian.

use super::super::number::{Decimal, quantity};
use super::super::words::{ends, fold, has};
use super::sizes::size_mm;

/// A fine addition to the cement.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Addition {
    FlyAsh,
    Slag,
    SilicaFume,
    Filler,
    Pozzolan,
    Lime,
}

impl Addition {
    /// Its usual density, in kg/m³.
    pub(super) fn density_kg_m3(self) -> f64 {
        match self {
            Self::FlyAsh => 2300.0,
            Self::Slag => 2900.0,
            Self::SilicaFume => 2200.0,
            Self::Filler => 2700.0,
            Self::Pozzolan => 2500.0,
            Self::Lime => 2240.0,
        }
    }
}

/// Which water a row counts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Water {
    /// Not said.
    Any,
    /// What counts for the ratio to cement.
    Effective,
    /// What is added in the mixer.
    Added,
    /// With what the aggregates hold.
    Total,
}

/// What a label stands for.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Kind {
    Cement,
    /// Cement with its additions.
    Binder,
    Addition(Addition),
    Water(Water),
    Aggregate,
    AllAggregate,
    Admixture,
    Fibre,
    Air,
    WaterCement,
    /// Water over cement and additions, where these count by the factor k, if the label has one.
    WaterBinder(Option<f64>),
    AggregateCement,
    KValue,
    Total,
    /// The volume of the batch.
    Batch,
    Density,
    Absorption,
    Moisture,
    /// The name of the recipe.
    Name,
    /// Known, and no part of the concrete.
    Ignored,
    Unknown,
}

impl Kind {
    /// Whether it is a part that has a mass or a volume of its own.
    pub(super) fn is_part(self) -> bool {
        matches!(self, Self::Cement | Self::Binder | Self::Addition(_) | Self::Water(_))
            || matches!(self, Self::Aggregate | Self::AllAggregate)
    }
}

/// Whether a folded text speaks of a density of grains.
pub(super) fn has_density(folded: &str) -> bool {
    has(
        folded,
        "densit|density|dichte|rohdichte|kornrohdichte|reindichte|specific gravity|sp. gr|\
             sp.gr|sg|s.g.|masse volumique|densidad|peso especifico|gravedad especifica|\
             massa especifica|densidade|massa volumica|peso specifico|relative density|rho|\
             gravity",
    ) && !has(folded, "bulk|schutt|aparente|apparente|loose|fresh|frisch|betonrohdichte")
}

/// Whether a text can be that of a recipe: whether it has a word for cement, binder, water or concrete.
pub(super) fn may_be_concrete(text: &str) -> bool {
    const STEMS: [&str; 24] = [
        "ement",
        "iment",
        "cem",
        "opc",
        "ppc",
        "portland",
        "binde",
        "liant",
        "ligante",
        "legante",
        "water",
        "wasser",
        "agua",
        "eau",
        "acqua",
        "w/",
        "a/c",
        "e/c",
        "mort",
        "beton",
        "concret",
        "calcestruzzo",
        "argamassa",
        "traco",
    ];
    if !text.contains(char::is_alphabetic) {
        // A ratio of four numbers.
        return text.matches(':').count() >= 3;
    }
    let folded = fold(text);
    STEMS.iter().any(|stem| folded.contains(stem))
}

/// What a text stands for.
pub(super) fn kind(text: &str) -> Kind {
    let folded = fold(text).replace('_', " ");
    let folded = folded.trim();
    if folded.is_empty() {
        return Kind::Unknown;
    }
    let is = |words: &str| has(folded, words);
    let compact: String = folded.chars().filter(|c| !c.is_whitespace() && *c != '.').collect();
    if let Some(kind) = ratio(folded, &compact) {
        return kind;
    }
    if (has_density(folded) || is("gravity")) && !is("high density|air") {
        return Kind::Density;
    }
    if matches!(compact.as_str(), "ca" | "fa") || compact.starts_with("ca20") || compact.starts_with("ca10") {
        return Kind::Aggregate;
    }
    if is("lp-gehalt|lp gehalt|luftgehalt") {
        return Kind::Air;
    }
    if is("admixture|plasti|superplasti|fliessmittel|fm|sp|betonverfl|bv|verflussig|retard|\
             verzoger|accelerat|beschleun|lp|lp-mittel|luftporenbild|air entrain|air-entrain|aea|\
             aireante|incorporador|adjuvant|aditivo|additiv|superfluid|fluidific|hrwr|hrwra|wra|\
             water reduc|water-reduc|reducteur|reductor|redutor|stabili|viscosity|vma|\
             zusatzmittel|betonzusatzmittel|glenium|viscocrete|sika|entraineur|chemical|defoamer|\
             entschaumer|pigment|schwindreduz|shrinkage reduc")
    {
        return Kind::Admixture;
    }
    if is("fiber|fibre|faser|fibra|fibr") || ends(folded, "faser|fasern") {
        return Kind::Fibre;
    }
    if is("absor|wasseraufnahme|assorb") {
        return Kind::Absorption;
    }
    if is("moisture|feucht|eigenfeuchte|oberflachenfeuchte|humed|humid|umid|teneur en eau") {
        return Kind::Moisture;
    }
    let is_water = is("water|wasser|agua|eau|acqua|h2o") || ends(folded, "wasser");
    if matches!(
        compact.as_str(),
        "k" | "k-value" | "k-wert" | "kvalue" | "kwert" | "coefficientk" | "kfactor"
    ) {
        return Kind::KValue;
    }
    let is_total = is("total|summe|sum|gesamt|somme|suma|soma|insgesamt");
    let is_aggregate = aggregate(folded);
    if is_total {
        return if is_water || is("gesamtwasser") {
            Kind::Water(Water::Total)
        } else if is_aggregate || is("gesamtzuschlag|gesamtgestein") {
            Kind::AllAggregate
        } else if is("binder|cementit|bindemittel|liant|ligante|legante|powder|cement") {
            Kind::Binder
        } else if is("air|aire|luft") {
            Kind::Air
        } else {
            Kind::Total
        };
    }
    if is("batch|volume of|mischung|mischungsgrosse|chargen|volumen|volume|yield|ausbeute")
        && !is_water
        && !is_aggregate
        && !is("cement|zement|air|luft")
    {
        return Kind::Batch;
    }
    if is("slump|ausbreit|setzmass|konsisten|consist|strength|druckfest|festigkeit|resist|fck|\
             fc'|temperat|dmax|d max|grosstkorn|exposition|exposure|age|price|preis|cost|prix|\
             co2|fineness|modulus|modulo|module|finesse|paste|mehlkorn|yield|date|datum|fecha|\
             data|fresh density|unit weight|frischbeton|rohdichte|bulk density|schuttdichte|\
             affaissement|asentamiento|abatimento|abbassamento|revenimiento|flow|maximum size|\
             void|sand ratio|s/a|standard deviation|target|grade of concrete|nominal maximum|\
             supplier|lieferant|hersteller|festbeton|workability|remark|bemerkung|note")
        && !is_water
    {
        return if is("void") && is("air") { Kind::Air } else { Kind::Ignored };
    }
    if !is_water && is("air|luft|luftgehalt|luftporen|lp-gehalt|aire|ar|aria|entrapped") {
        return Kind::Air;
    }
    if is_water {
        return Kind::Water(water(folded));
    }
    if let Some(kind) = binder(folded, is_aggregate) {
        return kind;
    }
    if is_aggregate {
        return Kind::Aggregate;
    }
    if is("mix|mixture|recipe|rezept|sorte|bezeichnung|sample|id|nr|no|name|series")
        || is("mezcla|melange|traco|miscela|serie|betonsorte|designation|specimen|concrete")
        || is("class|klasse|clase|classe")
    {
        return Kind::Name;
    }
    // What is unknown and has a size is an aggregate, be it `10 mm` or `Basalt 8/16`.
    if size_mm(text).is_some() { Kind::Aggregate } else { Kind::Unknown }
}

fn ratio(folded: &str, compact: &str) -> Option<Kind> {
    let k = || {
        let at = folded.find(|c: char| c.is_ascii_digit())?;
        quantity(&folded[at..], Decimal::Point).map(|k| k.value).filter(|k| (0.05..=2.0).contains(k))
    };
    let begins = |names: &[&str]| {
        names.iter().any(|name| {
            compact.strip_prefix(name).is_some_and(|rest| !rest.starts_with(char::is_alphabetic))
                || folded.split_whitespace().any(|word| word.trim_matches(['.', ',']) == *name)
        })
    };
    if begins(&["w/zeq", "w/ceq", "w/z)eq", "w/c)eq"])
        || compact.contains("w/zeq")
        || compact.contains("(w/z)eq")
    {
        return Some(Kind::WaterBinder(k().or(Some(0.4))));
    }
    if compact.starts_with("w/c+") || compact.starts_with("w/z+") || compact.starts_with("e/c+") {
        return Some(Kind::WaterBinder(k()));
    }
    if begins(&["w/b", "w/cm", "w/bm", "w/(c+f)", "e/l", "a/l", "a/b", "a/mc", "w/p"]) {
        return Some(Kind::WaterBinder(k()));
    }
    if begins(&["w/c", "w/z", "e/c", "w/z-wert", "wz-wert", "wz"]) {
        return Some(Kind::WaterCement);
    }
    // Water over cement in three languages; aggregate over cement in English.
    if begins(&["a/c"]) {
        return Some(if has(folded, "aggregate") { Kind::AggregateCement } else { Kind::WaterCement });
    }
    if compact.starts_with("wasserzement") || compact.starts_with("wasser-zement") {
        return Some(Kind::WaterCement);
    }
    let ratio_word = has(folded, "ratio|rapport|relacion|relacao|rapporto|wert|fator|razon")
        || folded.contains('/')
        || folded.contains(" to ");
    let water = has(folded, "water|wasser|agua|eau|acqua");
    let cement = has(folded, "cement|zement|ciment|cimento") || folded.contains("/cement");
    let binder = has(folded, "binder|cementit|bindemittel|liant|ligante|legante|powder");
    match (ratio_word && !has(folded, "reduc"), water, cement, binder) {
        (true, true, _, true) => Some(Kind::WaterBinder(k())),
        (true, true, true, false) => Some(Kind::WaterCement),
        (true, false, true, false) if has(folded, "aggregate") => Some(Kind::AggregateCement),
        _ => None,
    }
}

fn water(folded: &str) -> Water {
    let is = |words: &str| has(folded, words);
    if is("effect|effekt|efec|effic|effett|efic|eff|eff.|free|wirksam|net|design|diseno") {
        Water::Effective
    } else if is("added|add|zugabe|batch|mixing water added|ajout|anadida|adicionada|aggiunt|\
             to be added")
    {
        Water::Added
    } else {
        Water::Any
    }
}

/// Cement, binder or an addition.
fn binder(folded: &str, is_aggregate: bool) -> Option<Kind> {
    let is = |words: &str| has(folded, words);
    let is_cement = is("cement|zement|ciment|cimento|cem|opc|ppc|portland|pc") || ends(folded, "zement");
    let addition = if is("fly ash|fly-ash|flyash|flugasche|cendre|ceniza|cinza|cenere|ceneri|pfa") {
        Some(Addition::FlyAsh)
    } else if is("silica fume|silicafume|microsilica|micro silica|micro-silica|silikastaub|mikrosilika")
        || is("fumee de silice|humo de silice|silica ativa|fumo di silice|microsilice|nanosilica|\
             sf|silica")
            && !is_aggregate
    {
        Some(Addition::SilicaFume)
    } else if is("slag|ggbs|ggbfs|bfs|huttensand|laitier|escoria|loppa|scoria|blast furnace")
        && !is("slag sand|slag aggregate")
    {
        Some(Addition::Slag)
    } else if is("metakaolin|metacaolin|pozzolan|puzzolan|pouzzolane|puzolana|pozolana|trass|rice husk") {
        Some(Addition::Pozzolan)
    } else if is("filler|powder|flour|kalksteinmehl|kalkmehl|steinmehl|gesteinsmehl|quarzmehl|fuller|\
             fines")
        && !is("stone powder sand")
        || ends(folded, "mehl")
    {
        Some(Addition::Filler)
    } else if is("lime|kalkhydrat|hydrated lime|chaux|cal hidratada|calce") && !is("limestone") {
        Some(Addition::Lime)
    } else {
        None
    };
    let is_us_slag = is("slag cement") && !is("portland|cem");
    match addition {
        Some(addition) if !is_cement || is_us_slag => return Some(Kind::Addition(addition)),
        Some(_) if folded.contains('+') => return Some(Kind::Binder),
        _ => {}
    }
    if is("binder|cementitious|bindemittel|liant|ligante|legante|aglomerante") {
        return Some(Kind::Binder);
    }
    is_cement.then_some(Kind::Cement)
}

fn aggregate(folded: &str) -> bool {
    has(
        folded,
        "aggregate|agg|agg.|sand|gravel|kies|sable|gravier|gravillon|arena|grava|gravilla|\
             areia|brita|pedrisco|sabbia|ghiaia|ghiaietto|pietrisco|splitt|edelsplitt|schotter|\
             gestein|zuschlag|korn|kornung|jelly|arido|agregado|granulat|inerte|inerti|aggregat|\
             stone|rock|grit|chipping|granit|basalt|diabas|quartz|quarz|limestone|kalkstein|\
             dolomit|recycled|rca|lwa|leca|liapor|blahton|perlite|perlit|expanded|metal|m-sand|\
             msand|crusher|quarry|piedra|pierre|seixo|po de pedra|cascalho|gravetto|misto|\
             granulometria|rezyklat|moraine|pea gravel|grade sand|caliza|calcaire|gres|ca|fa|\
             concassage|concasse|coarse|fine|grueso|graudo|fino|miudo",
    ) || ends(folded, "sand|kies|splitt|schotter|kornung|zuschlag|granulat")
}

/// Whether a label is `FA`, which is fine aggregate beside `CA` and fly ash elsewhere.
pub(super) fn is_fa(name: &str) -> bool {
    matches!(fold(name).trim(), "fa" | "f.a." | "f.a")
}

/// Whether a label is `CA`, coarse aggregate.
pub(super) fn is_ca(name: &str) -> bool {
    matches!(fold(name).trim(), "ca" | "c.a." | "c.a")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parts_are_known_in_six_languages() {
        for (text, expected) in [
            ("Zement CEM I 42,5 R", Kind::Cement),
            ("Portland cement, Type I/II", Kind::Cement),
            ("Ciment CEM II/A-LL 42,5 R", Kind::Cement),
            ("Cemento", Kind::Cement),
            ("Cimento CP II", Kind::Cement),
            ("OPC 53 grade", Kind::Cement),
            ("Portlandzement", Kind::Cement),
            ("Flugasche", Kind::Addition(Addition::FlyAsh)),
            ("Cendres volantes", Kind::Addition(Addition::FlyAsh)),
            ("GGBS", Kind::Addition(Addition::Slag)),
            ("Slag cement", Kind::Addition(Addition::Slag)),
            ("Blast Furnace Slag", Kind::Addition(Addition::Slag)),
            ("Silica fume", Kind::Addition(Addition::SilicaFume)),
            ("Kalksteinmehl", Kind::Addition(Addition::Filler)),
            ("Filler calcaire", Kind::Addition(Addition::Filler)),
            ("Wasser", Kind::Water(Water::Any)),
            ("Gesamtwasser", Kind::Water(Water::Total)),
            ("Zugabewasser", Kind::Water(Water::Added)),
            ("Eau efficace", Kind::Water(Water::Effective)),
            ("Agua de diseño", Kind::Water(Water::Effective)),
            ("Acqua", Kind::Water(Water::Any)),
            ("Água", Kind::Water(Water::Any)),
            ("w/z", Kind::WaterCement),
            ("W/C ratio", Kind::WaterCement),
            ("Water Cement ratio", Kind::WaterCement),
            ("Relación agua/cemento", Kind::WaterCement),
            ("w/b", Kind::WaterBinder(None)),
            ("w/(c + 0.4 f)", Kind::WaterBinder(Some(0.4))),
            ("(w/z)eq", Kind::WaterBinder(Some(0.4))),
            ("Water-binder ratio", Kind::WaterBinder(None)),
            ("Sand 0/2", Kind::Aggregate),
            ("20 mm Jelly", Kind::Aggregate),
            ("Gravillons 4/12", Kind::Aggregate),
            ("Agregado grueso", Kind::Aggregate),
            ("Brita 1", Kind::Aggregate),
            ("Ghiaia 8-16", Kind::Aggregate),
            ("Natursand", Kind::Aggregate),
            ("8/16", Kind::Aggregate),
            ("10 mm", Kind::Aggregate),
            ("Quartz sand", Kind::Aggregate),
            ("Crushed limestone", Kind::Aggregate),
            ("Total aggregate", Kind::AllAggregate),
            ("Total", Kind::Total),
            ("Summe", Kind::Total),
            ("Superplasticizer", Kind::Admixture),
            ("Fließmittel", Kind::Admixture),
            ("Water reducer", Kind::Admixture),
            ("Air-entraining agent", Kind::Admixture),
            ("Stahlfasern", Kind::Fibre),
            ("Air", Kind::Air),
            ("Luftporen", Kind::Air),
            ("Air content", Kind::Air),
            ("Slump", Kind::Ignored),
            ("Specific gravity of cement", Kind::Density),
            ("Water absorption", Kind::Absorption),
            ("Contenido de humedad", Kind::Moisture),
            ("Pan", Kind::Unknown),
            ("mix", Kind::Name),
        ] {
            assert_eq!(kind(text), expected, "{text}");
        }
    }
}
