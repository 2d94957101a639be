"""Phrases that say outright what a body part does, and the words the networks were trained on for them.

Each table is searched in order, first match wins. `{s}` stands for left or right. Descriptions use the vocabulary of
the training styles, so that their embeddings lie near trained ones.
"""

from __future__ import annotations

import re
from functools import cache

ARM_NOUNS = r"upper arm|forearm|arm|hand|fist|elbow|wrist|finger|palm"
LEG_NOUNS = r"leg|knee|foot|feet|thigh|ankle|heel|toe"
TORSO_NOUNS = r"upper body|torso|back|chest|spine|shoulder|hip|waist|body"
HEAD_NOUNS = r"head|chin|neck|gaze|eye|face"

ARM_ACTIONS: tuple[tuple[str, str], ...] = (
    (
        r"behind .*\b(?:head|neck)\b|on .*\bhead\b",
        "{s} hand behind the head, elbow raised out to the side, held still",
    ),
    (
        r"overhead|above .*head|in the air|straight up|up high|high up|towards? the sky|raised high",
        "{s} arm raised straight up overhead, elbow straight, held still",
    ),
    (
        r"on .*\b(?:hips?|waist)\b|akimbo",
        "{s} hand on the hip, elbow bent and pointing out to the side, held still",
    ),
    (r"\bcross|\bfold", "{s} arm folded across the chest, elbow bent, held still"),
    (
        r"behind (?:the |his |her |their |its |my )?(?:back|body)|clasped behind|\bbehind$",
        "{s} hand held behind the back, elbow bent, not swinging",
    ),
    (r"pocket", "{s} hand in the pocket beside the hip, elbow slightly bent, not swinging"),
    (r"armpit", "{s} hand at the armpit, elbow bent sharply and raised out to the side"),
    (
        r"(?:on|at|over|to|against|clutching|holding) .*(?:stomach|belly|ribs?|side|wound)\b",
        "{s} hand held against the stomach, elbow bent, not swinging",
    ),
    (r"sling|\bbroken\b|bandage|in a cast", "{s} arm bent, forearm held against the chest, not swinging"),
    (r"flap", "{s} elbow raised out to the side, arm bent and flapping up and down like a wing"),
    (
        r"like (?:a )?(?:bird'?s? |plane'?s? )?wings?|out to the sides?|sideways|spread|t-pose|to the sides?\b.*(?:shoulder|straight)",
        "{s} arm stretched straight out to the side at shoulder height, elbow straight, held still",
    ),
    (r"chop|karate", "{s} hand held like a blade in front of the chest, arm chopping down sharply"),
    (r"punch|box", "{s} fist clenched in front of the chest, elbow bent, punching forward quickly"),
    (r"guard|block", "{s} fist raised in front of the face, elbow bent, held tense"),
    (r"\bwav(?:e|es|ing|ed)\b", "{s} hand raised above the head, waving from side to side"),
    (
        r"in front|forward|outstretched|reach|stretched out|extend|groping|feeling",
        "{s} arm stretched out in front at chest height, elbow nearly straight",
    ),
    (r"clench|fist", "{s} fist clenched beside the hip, elbow slightly bent, arm tense"),
    (
        r"\b(?:no|not|without|barely|hardly|never) (?:any )?(?:swing|mov)|motionless|\bstill\b|\bstiff|rigid|glued|pressed|pinned|tight|close",
        "{s} arm hanging straight down at the side, held still, not swinging",
    ),
    (
        r"hang|limp|dangl|slack|loose|lifeless|droop|floppy",
        "{s} arm hanging limply at the side, hardly swinging",
    ),
    (r"pump", "{s} arm pumping briskly forward and back, elbow bent at a right angle"),
    (
        r"swing.*(?:wide|high|hard|big|strong|exaggerat|wild|broad)|(?:wide|big|wild|broad|exaggerat)\w* .*swing",
        "{s} arm swinging widely and high with each step",
    ),
    (r"swing.*(?:little|slight|gentl|soft|small)", "{s} arm swinging gently, close to the side"),
    (r"swing|sway", "{s} arm loose, elbow slightly bent, swinging naturally forward and back"),
    (r"\brais|\blift|\bup\b|\bheld up|\bhigh\b", "{s} arm raised, hand above the head"),
    (r"chest", "{s} hand held in front of the chest, elbow bent"),
    (r"\bbent\b|\bbend|tucked", "{s} elbow bent at a right angle, hand at waist height"),
    (
        r"straight down|at (?:the |his |her |their )?sides?|relaxed|down\b",
        "{s} arm hanging relaxed at the side",
    ),
    (r"straight", "{s} arm straight, elbow not bending, swinging stiffly"),
    (r"carry|hold", "{s} hand held in front of the waist, elbow bent, not swinging"),
    (r"shak|trembl|twitch", "{s} arm bent, hand trembling in front of the waist"),
)

LEG_ACTIONS: tuple[tuple[str, str], ...] = (
    (
        r"limp|lame|injur|wound|hurt|broken|sprain|hobbl|twisted|sore|bad\b",
        "{s} leg limping, knee stiff, foot dragging in short uneven steps",
    ),
    (r"drag|trail", "{s} leg dragging behind, foot scuffing the ground"),
    (r"tip-?toe|on .*toes", "{s} leg stepping on tiptoe, heel raised high off the ground"),
    (
        r"stiff|straight|wooden|rigid|lock",
        "{s} leg stiff and straight, knee not bending, foot swinging forward",
    ),
    (
        r"deep|crouch|squat|very bent",
        "{s} knee bent deeply, leg crouching, stepping low to the ground",
    ),
    (r"high|lift|rais|up\b", "{s} leg stepping with the knee lifting high, foot raised off the ground"),
    (r"\bbent\b|\bbend|soft", "{s} knee bent, leg stepping low and carefully"),
    (r"wide|apart|spread|bow-?leg", "{s} leg stepping widely, feet far apart, knee turned outward"),
    (r"together|narrow|cross|one line|close", "{s} leg stepping in front of the other on a narrow line"),
    (r"stomp|stamp|slam|heav", "{s} leg stomping, foot hitting the ground hard"),
    (r"shuffl|slid|scuff|barely", "{s} leg shuffling in short slow steps, foot barely leaving the ground"),
    (r"kick", "{s} leg kicking out forward with each step, knee straight"),
    (r"still|planted|standing", "{s} leg standing still, foot planted on the ground"),
    (r"short|small|tiny", "{s} leg taking short quick steps, foot lifted barely"),
    (r"long|big|strid", "{s} leg striding in long steps"),
    (r"bounc|spring|hop|skip", "{s} leg stepping lightly with a bounce, foot springing off the toes"),
    (r"wobbl|unstead|shak|buckl", "{s} leg unsteady, knee buckling, foot placed wide"),
    (r"turned in|pigeon|inward", "{s} foot turned inward, leg taking short steps"),
    (r"turned out|outward", "{s} foot turned outward, leg stepping widely"),
)

TORSO_ACTIONS: tuple[tuple[str, str], ...] = (
    (
        r"(?:lean|bent|bend|tilt|tip)\w* (?:far |slightly |heavily )?back|arched",
        "torso leaning back, chest raised",
    ),
    (r"(?:lean|tilt|bent|bend|tip)\w* .*\bleft\b", "torso leaning to the left side"),
    (r"(?:lean|tilt|bent|bend|tip)\w* .*\bright\b", "torso leaning to the right side"),
    (r"slump|droop|sag|sunken|cav", "torso slumped forward, shoulders drooping, chest sunken"),
    (
        r"hunch|stoop|round|slouch|crook|bent|bend|bow|curv",
        "torso bent forward, back rounded, shoulders rolled forward",
    ),
    (r"lean|pitch|forward|tilt|tip", "torso leaning forward from the hips, back straight"),
    (
        r"rais|shrug|tens|lift|up\b|tight",
        "torso tense, shoulders raised towards the ears",
    ),
    (
        r"pulled back|drawn back|\bback\b|broad|wide|puff|\bout\b|proud",
        "chest pushed out, shoulders pulled back",
    ),
    (
        r"hip.*(?:sway|swing|roll)|(?:sway|swing|roll)\w* .*hip",
        "hips swaying widely from side to side, torso upright",
    ),
    (r"sway|rock|roll|swing|wobbl", "torso swaying heavily from side to side"),
    (r"twist|rotat|turn", "torso twisting widely with each step"),
    (r"straight|upright|erect|stiff|rigid|tall|still", "torso upright and stiff, spine straight, held still"),
    (r"bounc|bob", "torso bouncing up and down with each step"),
    (r"relax|loose|soft", "torso upright and relaxed, shoulders loose and level"),
    (r"shak|shiver|trembl", "torso tense and trembling, shoulders drawn in"),
)

HEAD_ACTIONS: tuple[tuple[str, str], ...] = (
    (r"(?:tilt|lean|cock|bent)\w* .*\bleft\b", "head tilted to the left side"),
    (r"(?:tilt|lean|cock|bent)\w* .*\bright\b", "head tilted to the right side"),
    (
        r"\bleft\b.*\bright\b|around|about|side to side|everywhere",
        "head turning slowly from side to side, searching",
    ),
    (r"over .*shoulder|behind|backwards", "head turned to the side, looking back over the shoulder"),
    (r"\bleft\b", "head turned to the left, looking left"),
    (r"\bright\b", "head turned to the right, looking right"),
    (
        r"down|low|bow|hang|droop|drop|sunk|floor|ground|feet|phone|book|hands|tucked|ashamed",
        "head hanging down, looking at the ground",
    ),
    (r"bob|nod|peck", "head bobbing forward and back with each step"),
    (r"shak", "head shaking from side to side"),
    (r"tilt|cock|lean", "head tilted to the side"),
    (r"roll|loll|wobbl|sway", "head lolling loosely from side to side"),
    (
        r"thrown back|\bback\b|sky|ceiling|\bup\b|upwards?|high|rais|lift",
        "head tilted back, chin raised, looking up",
    ),
    (r"forward|jut|thrust|poked|stretched|out\b", "head pushed forward, neck stretched"),
    (r"turn", "head turning slowly from side to side"),
    (r"still|steady|straight|level|upright|ahead|erect", "head upright and still, looking straight ahead"),
)

# Phrases without a body part's name: pattern, what it is looked up in, the words looked up ("" = the phrase itself).
_SIDE = r"(?P<side>left|right)"
IDIOMS: tuple[tuple[str, str, str], ...] = (
    (
        rf"\b(?:limping|limps|limp|hobbling|hobbles|lame)(?:\s+\w+){{0,5}}?\s+{_SIDE}(?:\s+(?:leg|foot|knee|ankle|side))?\b",
        "leg",
        "limping",
    ),
    (r"\blimping\b|\blimps\b|\bwith a limp\b|\bhobbling\b|\bhobbles\b", "one_leg", "limping"),
    (
        r"\b(?:with )?(?:no|without|zero)(?: any)? (?:arm|hand)[- ]?(?:swing|swinging|movement|motion)s?\b"
        r"|\b(?:with)?out (?:swinging|moving) (?:the|his|her|their|its|both)? ?(?:arms|hands)\b"
        r"|\b(?:not|never) (?:swinging|moving) (?:the |his |her |their )?(?:arms|hands)\b",
        "arms",
        "no swing",
    ),
    (r"\bt-pose\b", "arms", "t-pose"),
    (r"\bhands up\b", "arms", "straight up"),
    (r"\barms? akimbo\b", "arms", "akimbo"),
    (
        r"\b(?:look|star|gaz|glanc|peer)(?:ing|s)\s+(?:\w+\s+){0,4}?(?:down|up|left|right|around|behind|back|ahead|side to side|sky|floor|ground|feet|phone|book|hands|shoulder|upwards?|downwards?|ceiling)(?: (?:and|or) (?:left|right|down|up))?(?: (?:at|to|towards|on|over|his|her|the|their|its|my|sides?|sky|floor|ground|feet|shoulders?|left|right)\b)*",
        "head",
        "",
    ),
    (r"\bnodding(?: (?:his|her|their|the) head)?\b", "head", "nodding"),
    (
        r"\b(?:leaning|leans|leant|tilting|tilted|bending|bent)(?: (?:far|slightly|heavily|deeply|a bit|a little|way))?"
        r"(?: (?:over|to|into))?(?: (?:the|one|his|her|their))?(?: (?:forwards?|backwards?|back|left|right|sideways|side|over|double|wind))(?: side)?\b",
        "torso",
        "",
    ),
    (
        r"\b(?:hunched|hunching|stooped|stooping|slouched|slouching|hunchbacked)(?: (?:over|forward|down))?\b",
        "torso",
        "",
    ),
    (
        r"\b(?:standing|walking|sitting|staying|held) (?:very |bolt )?(?:tall|upright|straight|erect)\b",
        "torso",
        "upright",
    ),
    (
        r"\b(?:on|upon) (?:the |his |her |their )?(?:tip-?)?toes\b|\b(?:on )?tip-?toe(?:s|ing)?\b",
        "legs",
        "tiptoe",
    ),
    (r"\b(?:with )?(?:bent|bending) knees\b|\bknees bent\b", "legs", "bent"),
    (r"\bcrouch(?:ing|ed|es)?\b|\bsquatting\b", "legs", "crouch"),
    (r"\bhigh[- ]knees\b|\bknees high\b", "legs", "high"),
    (r"\b(?:wide|broad)[- ](?:legged|stance)\b|\bbow-?legged\b", "legs", "wide"),
    (r"\bnarrow stance\b|\bfeet (?:close )?together\b", "legs", "narrow"),
    (r"\b(?:short|small|tiny|little|baby) steps\b", "legs", "short"),
    (r"\b(?:long|big|large|giant) (?:steps|strides)\b", "legs", "long"),
    (r"\bdragging (?:the |his |her |their )?feet\b", "legs", "drag"),
    (r"\bpigeon-?toed\b", "legs", "pigeon"),
)

# Words before a part's name that make it a statement about that part: "raised left arm", "crossed arms".
LEADING_VERBS = (
    r"raised|raising|raises|crossed|crossing|folded|folding|clenched|clenching|outstretched|stretched|stretching|"
    r"swinging|swings|waving|waves|hanging|dangling|bent|bending|bowed|bowing|lowered|lowering|tilted|tilting|stiff|"
    r"limp|dragging|drags|hunched|slumped|flapping|flaps|spread|spreading|lifting|lifts|lifted|shaking|shakes|"
    r"nodding|bobbing|turned|turning|straight|rounded|arched|drooping|trembling|rigid|injured|broken|wounded|lame|"
    r"pumping|swaying|twisting|rolling|shrugging|shrugged|loose|extended|extending|reaching"
)
# Words after a part's name that make it a statement, besides any -ing or -ed form.
FOLLOWING_WORDS = (
    r"straight|stiff|still|bent|limp|loose|low|high|up|down|out|outstretched|in|on|behind|at|over|above|back|forward|"
    r"akimbo|wide|close|held|kept|hung|swung|thrust|is|are|like|as|apart|together|upright|raised|rigid|slack|between|"
    r"against|around|sunk|spread|under|beside|across|to|near|relaxed|tense|tight"
)

# What a prompt may still say when its clauses are taken out, without naming a style of its own.
FILLER_WORDS = (
    "a an the and with while but of in on to is are as who that whose his her their its this one some someone somebody "
    "person man woman human character figure people guy girl boy he she they it walking walk walks moving move moves "
    "standing stand running run runs going normal normally please make him them be being both very just my your i am me we you"
)


@cache
def compiled(pattern: str) -> re.Pattern[str]:
    """The compiled pattern; compiled once, at first use."""
    return re.compile(pattern, re.IGNORECASE)
