//! What titles and heads say beside units: names of recipes, states of aggregates, volumes.

use super::super::number::Decimal;
use super::super::words::{fold, has};
use super::units::batch_m3;

/// Whether a text says that parts are counted by volume.
pub(super) fn says_volume(text: &str) -> bool {
    let words = "by volume|raumteile|volumenteile|en volume|por volumen|en volumen|em volume|in volume";
    has(&fold(text), words)
}

/// Words that every head may have.
const GENERAL: &str = "
    content gehalt amount amounts menge mengen quantity quantities quantite cantidad quantidade quantita weight
    weights mass masse masa massa peso poids gewicht wt dosage dosificacion dosaggio dosagem value proportion
    proportions wert per pro for fur par por 1 m3 einwaage of concrete beton ssd dry wet moist field adjusted
    corrected trocken seco sec secco batch design mix unit kg in stoffmenge by material materials stoff
    component components ingredient ingredients one mischung para de hormigon du des la mezcla concreto betons
    calcestruzzo rezeptur betonrezeptur rezept mischungsentwurf betonzusammensetzung composition teneur
    contenuto contenido saturated surface trial
";

/// A name without words that every head may have, and the rank of the state that it names: surface-dry before dry
/// before weighed.
pub(super) fn key(head: &str) -> (Option<String>, u32) {
    let folded = fold(head);
    let state = if has(&folded, "ssd|surface dry|saturated") {
        0
    } else if has(&folded, "dry|trocken|seco|sec|secco") {
        2
    } else if has(&folded, "wet|moist|field|adjusted|corrected|batch|trial|feucht|obra") {
        3
    } else {
        1
    };
    let is_general = |word: &str| {
        let word = fold(word);
        let word = word.trim().trim_matches(['.', ',', '/']).trim();
        word.is_empty() || GENERAL.split_whitespace().any(|general| general == word)
    };
    let is_named = head.split_whitespace().any(|word| !is_general(word));
    let states = ["ssd", "dry", "wet", "moist", "field", "adjusted", "corrected", "saturated", "surface"];
    let name = head.split_whitespace().filter(|word| !states.contains(&fold(word).trim()));
    let name = name.collect::<Vec<_>>().join(" ");
    let name = name.trim_matches(|c: char| c.is_whitespace() || "()[],:;".contains(c)).to_owned();
    (is_named.then_some(name), state)
}

/// The name of a recipe in a title; `None` where it is a sentence.
pub(super) fn title_name(title: &str) -> Option<String> {
    let text = title.split(['(', '[']).next().unwrap_or(title).trim();
    let text = text.trim_matches(|c: char| c.is_whitespace() || ":;=#*-–|_".contains(c));
    // The volume that the amounts are for is no name.
    let volume = [" per ", " pro ", " for ", " für ", " por ", " par ", " je ", " pour ", " para "]
        .iter()
        .find_map(|word| text.find(word).filter(|&at| batch_m3(&text[at..], Decimal::Point).is_some()));
    let text = &text[..volume.unwrap_or(text.len())];
    let text = text.rsplit_once(": ").map_or(text, |(_, name)| name.trim());
    let (name, _) = key(text);
    name.filter(|name| name.chars().count() <= 60 && name.chars().any(char::is_alphanumeric))
}
