"""Patterns by which a prompt says outright what a body part does; `clause_words` has what is made of them."""

from __future__ import annotations

import re
from functools import cache

from sport.runtime.prompts.english import clause_words as words

ARM_NOUNS = r"upper arm|forearm|arm|hand|fist|elbow|wrist|finger|palm"
LEG_NOUNS = r"leg|knee|foot|feet|thigh|ankle|heel|toe"
TORSO_NOUNS = r"upper body|torso|back|chest|spine|shoulder|hip|waist|body"
HEAD_NOUNS = r"head|chin|neck|gaze|eye|face|nose"

# name, nouns, what its actions are called, what they are when denied
GROUPS = (
    ("arm", ARM_NOUNS, words.ARM_ACTIONS, words.ARM_DENIED),
    ("leg", LEG_NOUNS, words.LEG_ACTIONS, words.LEG_DENIED),
    ("torso", TORSO_NOUNS, words.TORSO_ACTIONS, words.TORSO_DENIED),
    ("head", HEAD_NOUNS, words.HEAD_ACTIONS, words.HEAD_DENIED),
)
NOUNS = "|".join(nouns for _, nouns, _, _ in GROUPS)
OWNERS = r"(?:his|her|their|the|its|my|your|a|an|one|both|left|right|two|other|neither|no|either|any)"
DENIES = (
    r"\b(?:no|not|never|without|neither|nor|isn't|aren't|doesn't|don't|didn't|cannot|can't|won't|mustn't|shouldn't|"
    r"avoid(?:s|ing)?|stop(?:s|ped)?|quit|refus(?:es|ing) to|(?:keep|refrain)(?:s|ing)? from)\b"
)
SLIGHTLY = r"\b(?:slightly|less|a little|a bit|a touch|somewhat|gently|half|halfway|barely|hardly)\b"
FAR = r"\b(?:far|deep(?:ly)?|very|way|strongly|heavily|extremely|completely|fully|all the way|much|a lot|(?:[4-9]\d|1\d\d) degrees|low|wide(?:ly)? apart|on (?:the|his|her) chest)\b"
# words before an action that say how much of it
DEGREES = r"(?:(?:very|far|slightly|heavily|deeply|a bit|a little|strongly|somewhat|extremely|much)\b)"
# set phrases that only sound like a statement about a part
NO_CLAUSE = (
    r"^(?:in|to|over|by|on) (?:hand|arm|heels?|toes?|foot|side|head|duty)\b|^(?:to|in) (?:school|work|business|time|the future|charge)\b"
    r"|^(?:closed|shut|covered|of|off(?! the (?:ground|floor))|over heels)\b|^(?:like|as) (?!(?:a |an )?(?:(?:bird|plane)'?s? )?wings?)|^(?:down|up) in\b"
)
# "trunk" where it is the body's and not an elephant's
TRUNK = r"\btrunk(?= (?:is )?(?:upright|straight|erect|still|stable|vertical|lean\w*|bent|flex\w*|rotat\w*|sway\w*)\b)"
# Words before a part's name that make it a statement about that part: "raised left arm", "crossed arms".
LEADING_VERBS = (
    r"raised|raising|raises|crossed|crossing|folded|folding|clenched|clenching|outstretched|stretched|stretching|"
    r"swinging|swings|waving|waves|hanging|dangling|bent|bending|bends|bowed|bowing|lowered|lowering|tilted|tilting|stiff|"
    r"limp|dragging|drags|hunched|slumped|flapping|flaps|spread|spreading|lifting|lifts|lifted|shaking|shakes|"
    r"nodding|bobbing|turned|turning|straight|rounded|arched|drooping|trembling|rigid|injured|broken|wounded|lame|"
    r"pumping|swaying|twisting|rolling|shrugging|shrugged|loose|extended|extending|reaching|moving|flailing|clasped|"
    r"hunching|arching|puffing out|sticking out|pushing out|thrusting out|throwing back|wiggling|holding up|holding out"
)
# The same in the words of an instruction: "lower the elbows", "swings the arms", "keeping his head up". They need an
# owner where the word after them is "back", which is no body part in "hold back", "turn back".
ORDERS = (
    r"(?:raise|lift|lower|drop|relax|loosen|tense|stiffen|straighten|bend|cross|fold|clench|stretch|extend|swing|wave|"
    r"hang|drag|tilt|turn|rotate|twist|shake|nod|bow|arch|hunch|round|puff|stick|push|thrust|pull|draw|tuck|point|spread|"
    r"flap|pump|sway|rock|roll|wiggle|shrug|move|bring|put|place|keep|hold|bounce|clasp|open|close)(?:e?s)?|"
    r"lowering|dropping|relaxing|loosening|tensing|stiffening|straightening|rotating|pushing|pulling|drawing|tucking|"
    r"pointing|bringing|putting|placing|keeping|clasping|bouncing|rocking"
)
# Words after a part's name that make it a statement, besides any -ing or -ed form.
FOLLOWING_WORDS = (
    r"straight|stiff|still|bent|limp|loose|low|high|up|down|out|outstretched|in|on|behind|at|over|above|back|forward|"
    r"akimbo|wide|close|held|kept|hung|swung|thrust|is|are|like|as|apart|together|upright|raised|rigid|slack|between|"
    r"against|around|sunk|spread|under|beside|across|to|near|relaxed|tense|tight|not|never|slightly|very|far|deeply|"
    r"half|stuffed|turned|sore|hurt|lame|weak|tucked|overhead|sideways|crossed|folded|off|inward|outward|thrown|drawn|flung|bound|spun|without|"
    r"swings?|hangs?|drags?|flaps?|points?|rests?|shakes?|droops?|dangles?|sways?|\w+ly|all over"
)
CLAUSE_START = rf"(?:{OWNERS}\b|(?:{NOUNS})s?\b|(?:{LEADING_VERBS})\b|look|lean|limp|hunch|crouch|lets? |letting |without |not |never |on |nose )"
POSTURE_VERBS = r"(?:looking|looks|staring|gazing|leaning|limping|hobbling|dragging|without (?:swinging|moving|bending|lifting|turning))"
# what a posture verb belongs to: "torso leaning back", "not looking down", "left foot dragging"
_HOLDERS = "not never without torso body back spine head face eyes gaze foot feet leg legs toes knee slightly far heavily"
_UNBROKEN = "".join(rf"(?<!\b{word})" for word in _HOLDERS.split())
# "and" separates clauses only where a new one begins, so that "up and down" stays whole
SEPARATOR = (
    rf"\s*[,;.:!?\n]+\s*|(?<!limping)(?<!hobbling)(?<!limps)\s+(?:with|while|but|whose)\s+|\s+and\s+(?={CLAUSE_START})"
    rf"|\s+(?:that|who|which)\s+(?=(?:has|keeps|holds|lets)\b)|{_UNBROKEN}\s+(?={POSTURE_VERBS}\b)"
)
NOUN_CLAUSE = (
    rf"^(?:please\s+)?(?:(?:with|and|has|having|keep|keeping|keeps|hold|holding|holds|lets|letting|let)\s+)?"
    rf"(?P<owners>(?:{OWNERS}\s+)*)(?P<noun>{NOUNS})s?\s+(?P<rest>(?:\w+ing|\w+ed|{FOLLOWING_WORDS})\b.*)$"
)
OTHER_CLAUSE = rf"^(?:with |and )?the other(?: one)?\s+(?P<rest>(?:\w+ing|\w+ed|{FOLLOWING_WORDS})\b.*)$"
VERB_CLAUSE = (
    rf"\b(?P<degree>{DEGREES}\s+)?(?P<verb>{LEADING_VERBS}|(?:{ORDERS})(?!\s+(?:back|face|side|body)\b))\s+"
    rf"(?P<owners>(?:{OWNERS}\s+)*)(?P<noun>{NOUNS})s?\b(?![- ]hop)(?P<rest>.*)$"
)
# "arms and legs stiff": one action of two parts
TWO_NOUNS = rf"\b(?P<first>(?:{NOUNS})s?)\s+and\s+(?P<second>(?:{NOUNS})s?)\s+(?P<rest>(?:\w+ing|\w+ed|{FOLLOWING_WORDS})\b[^,;.:!?]*)"

# Phrases without a body part's name: pattern, whose action it is, what is looked up ("" = the phrase itself).
_SIDE = r"(?P<side>left|right)"
_THE = r"(?:the |his |her |their |its |my )?"
_DENIED = r"(?P<denied>not |never |isn't |doesn't |without |no |without a |no longer )?"
# what is asked for less of, or not at all
_QUIET = r"(?:no|not|never|without|less|stop|stops|don't|do not|doesn't|avoid|zero)(?: any| so| too| as| much| all that)* "
_FIRST = rf"(?:{DEGREES} )?"
_SEEN = "sky|floor|ground|feet|ceiling|clouds|stars|shoes"  # where a gaze goes, with and without "at the"
_LEVEL = r"(?: (?:very far|so far|far|slightly|heavily|deeply|a bit|a little|way|right|all the way|strongly|somewhat))?"
IDIOMS: tuple[tuple[str, str, str], ...] = (
    (
        rf"\b{_DENIED}(?:limping|limps|limp|hobbling|hobbles|lame)(?:\s+\w+){{0,5}}?\s+{_SIDE}(?:\s+(?:leg|foot|knee|ankle|side))?\b",
        "leg",
        "limping",
    ),
    (
        r"\b(?P<denied>not |never |isn't |without a |without |no )(?:limping|limp|hobbling)\b",
        "legs",
        "limping",
    ),
    (r"\blimping\b|\blimps\b|\bwith a limp\b|\ba limp$|\bhobbling\b|\bhobbles\b", "one_leg", "limping"),
    (
        r"\b(?:with )?(?P<denied>no|without|zero)(?: any)? (?:arm|hand)[- ]?(?:swing|swinging|movement|motion)s?\b"
        r"|\b(?:with)?out (?:swinging|moving) (?:the|his|her|their|its|both|any)? ?(?:arms|hands)\b"
        r"|\b(?:not|never) (?:swinging|moving) (?:the |his |her |their )?(?:arms|hands)\b",
        "arms",
        "hanging still",
    ),
    (r"\b(?:wide|big|strong|broad|exaggerated) arm[- ]?swings?\b", "arms", "swinging widely"),
    (
        r"\b(?:little|small|slight|hardly any|barely any|less|reduced|minimal) arm[- ]?swing\b",
        "arms",
        "swinging little",
    ),
    (r"\bt-pose\b", "arms", "t-pose"),
    (r"\bhands up\b", "arms", "overhead"),
    (r"\barms? akimbo\b", "arms", "akimbo"),
    (r"\bempty[- ]handed\b", "arms", "swinging"),
    (
        rf"\b{_DENIED}{_FIRST}(?:look|star|gaz|glanc|peer)(?:ing|s|es)?\s+(?:\w+\s+){{0,4}}?(?:down|up|left|right|around|behind|back|ahead|side to side|{_SEEN}|phone|book|hands|shoulder|upwards?|downwards?)(?: (?:and|or) (?:left|right|down|up))?(?: (?:at|to|towards|on|over|his|her|the|their|its|my|sides?|{_SEEN}|shoulders?|left|right|moon|sun|toes)\b)*",
        "head",
        "",
    ),
    (rf"\b{_DENIED}nodding(?: {_THE}head)?\b", "head", "nodding"),
    (r"\b(?:nose|chin) (?:up|in the air|held high)\b", "head", "up"),
    (r"\bchin on (?:the |his |her )?chest\b", "head", "hanging"),
    (
        rf"\b{_DENIED}{_FIRST}(?:leaning|leans|leant|tilting|tilted|tilts?|bending|bends?|bent|lean){_LEVEL}"
        r"(?: (?:over|to|into))?(?: (?:the|one|his|her|their))?(?: (?:forwards?|backwards?|back|left|right|sideways|side|over|double|wind))(?: side)?(?: (?:from|at) the (?:waist|hips))?"
        r"(?: (?:slightly|far|a lot|a bit|(?:by |about )?\d+ degrees))?\b",
        "torso",
        "",
    ),
    (
        rf"\b{_QUIET}(?:(?:vertical|up[- ]and[- ]down) )?(?:bounc|bobb?)(?:e|es|ing|y|s)?\b(?: (?:up and down|so much|at all))*",
        "torso",
        "not bouncing",
    ),
    (
        rf"\b{_QUIET}(?:(?:hips?|body|shoulder)[- ])?(?:sway|swaying|rocking|wiggle|wiggling)\b"
        r"(?: (?:of|with|in) (?:the |his |her |their )?(?:hips?|body|shoulders?))?(?: so much| at all)*",
        "torso",
        "not swaying",
    ),
    (
        r"\b(?:belly|stomach|tummy|abs) (?:(?:pulled|sucked|drawn|tucked) )?in$"
        r"|\b(?:suck|pull|draw|tuck|hold)(?:s|ing)? in (?:the |his |her |their |your |my )?(?:belly|stomach|tummy|abs)\b",
        "torso",
        "upright",
    ),
    (
        rf"\b{_DENIED}{_FIRST}(?:hunched|hunching|stooped|stooping|slouched|slouching|hunchbacked)(?: (?:over|forward|down))?\b",
        "torso",
        "",
    ),
    (
        r"\b(?:standing|walking|sitting|staying|held) (?:very |bolt )?(?:tall|upright|straight|erect)\b",
        "torso",
        "upright",
    ),
    (
        rf"\b{_DENIED}(?:on|upon) {_THE}(?:tip-?)?toes\b|\b(?:on )?tip-?toe(?:s|ing)?\b",
        "legs",
        "tiptoe",
    ),
    (rf"\bon {_THE}heels\b", "legs", "on the heels"),
    (r"\b(?:with )?(?:slightly bent|softly bent) knees\b|\bknees slightly bent\b", "legs", "slightly bent"),
    (r"\b(?:with )?(?:deeply|very) bent knees\b|\bknees (?:deeply|very) bent\b", "legs", "deeply bent"),
    (r"\b(?:with )?(?:bent|bending) knees\b|\bknees bent\b", "legs", "bent"),
    (
        r"\b(?:deep(?:ly)? |very low |low )(?:crouch(?:ing|ed|es)?|squat(?:ting)?)\b|\bcrouch(?:ing|ed) (?:very )?(?:low|deeply)\b",
        "legs",
        "deep crouch",
    ),
    (r"\bslightly crouch(?:ing|ed)\b", "legs", "slightly bent"),
    (rf"\b{_DENIED}(?:crouch(?:ing|ed|es)?|squatting)\b", "legs", "crouch"),
    (r"\bhigh[- ]knees\b|\bknees high\b|\bknees lifted high\b", "legs", "high"),
    (r"\bvery wide[- ](?:legged|stance)\b|\bfeet (?:very )?far apart\b", "legs", "very wide"),
    (r"\b(?:wide|broad)[- ](?:legged|stance)\b|\bbow-?legged\b|\bfeet (?:wide )?apart\b", "legs", "wide"),
    (r"\bnarrow stance\b|\bfeet (?:close )?together\b", "legs", "narrow"),
    (
        r"\b(?:tiny|short|small|little|baby) (?:and )?(?:quick|hurried|fast|rapid|brisk|hasty) steps\b"
        r"|\b(?:quick|hurried|fast|rapid|hasty) (?:and )?(?:tiny|short|small|little|baby) steps\b|\bmincing(?: steps| gait| walk)?\b",
        "legs",
        "tiny hurried",
    ),
    (
        r"\b(?:long|big|large|giant|huge) (?:and )?slow (?:steps|strides)\b|\bslow (?:and )?(?:long|big|large|giant|huge) (?:steps|strides)\b",
        "legs",
        "long slow",
    ),
    (r"\b(?:short|small|tiny|little|baby) steps\b", "legs", "short"),
    (r"\b(?:long|big|large|giant) (?:steps|strides)\b", "legs", "long"),
    (rf"\bdragging {_THE}feet\b|\bfeet dragging\b|\bscuffing {_THE}feet\b", "legs", "drag"),
    (r"\bpigeon-?toed\b|\btoes (?:turned )?in(?:ward)?\b", "legs", "pigeon"),
    (r"\bduck-?(?:footed|toed)\b|\btoes (?:turned |pointing )?out(?:ward)?\b", "legs", "turned out"),
    (r"\bstiff-?legged\b|\b(?:locked|stiff) knees\b", "legs", "stiff"),
)


@cache
def compiled(pattern: str) -> re.Pattern[str]:
    """The compiled pattern; compiled once, at first use."""
    return re.compile(pattern, re.IGNORECASE)
