"""What a stated action of a body part is in the words that the networks were trained on.

Each table is searched in order, first match wins. `{s}` stands for left or right. Three sentences in place of one are
the action done slightly, plainly and far. Where `training/layering/catalog.py` has the action, its words are used.
"""

from __future__ import annotations

Sentences = str | tuple[str, str, str]
Actions = tuple[tuple[str, Sentences], ...]

ARM_ACTIONS: Actions = (
    (r"neck|behind .*\b(?:head|neck)\b|back of the head", "{s} hand behind the head, elbow out"),
    (r"\b(?:ears?|phone|cheek)\b", "{s} hand held to the ear, elbow bent sharply"),
    (
        r"\b(?:face|eyes?|mouth|nose|forehead|brow)\b",
        "{s} hand in front of the face",
    ),
    (r"\bchin\b", "{s} elbow bent sharply, hand held at the chin"),
    (
        r"overhead|(?:above|over) .*\bhead|straight up|\bsky\b|ceiling|up high|high up|in the air|\bup$",
        "{s} arm raised overhead",
    ),
    (r"\bon (?:top of )?.*\bhead\b|(?:scratch|hold|clutch)\w* .*\bhead\b", "{s} hand on the head"),
    (
        r"on .*\b(?:hips?|waist)\b|akimbo|\bat (?:the |his |her )?(?:hips?|waist)$",
        "{s} hand on the hip, elbow out to the side",
    ),
    (r"pocket", "{s} hand in the pocket"),
    (
        r"behind (?:the |his |her |their |its |my )?(?:back|body)|clasped behind|\bbehind$|on .*\bback\b",
        "{s} hand held behind the back",
    ),
    (
        r"in front of (?:the |his |her |their )?(?:chest|chin)\b.*\b(?:fist|guard)|guard|block|fists? (?:up|raised|held)",
        "{s} arm in a boxing guard, elbow bent sharply",
    ),
    (
        r"pray|palms? (?:pressed )?together|pressed together",
        "{s} palm pressed against the other in front of the chest, elbow bent sharply",
    ),
    (
        r"(?:clasp|join|fold|together)\w*\b.*\b(?:front|lap|waist)|clasped$|clasped together",
        "{s} hand held in front at waist height, elbow at the side",
    ),
    (r"armpit", "{s} arm folded across the chest"),
    (r"\bcross|\bfold", "{s} arm folded across the chest"),
    (r"\b(?:heart|chest)\b", "{s} hand on the chest"),
    (r"\b(?:stomach|belly|ribs?|tummy|wound)\b|on .*\bside\b", "{s} hand pressed on the stomach"),
    (r"\bon .*\b(?:knees?|thighs?)\b", "{s} arm straight down in front, hand pressing on the thigh"),
    (
        r"elbow.*(?:\bout\b|\bwing)",
        "{s} elbow bent and drawn back out to the side like a wing, hand behind the hip",
    ),
    (
        r"sling|\bbroken\b|bandage|in a cast|plaster|injur|hurt|wounded",
        "{s} elbow bent, forearm across the stomach, not swinging",
    ),
    (r"flap|beating up and down", "{s} arm out to the side, flapping up and down like a wing"),
    (r"\bwav(?:e|es|ing|ed)\b", "{s} hand raised high and waving from side to side"),
    (r"chop|karate", "{s} hand held like a blade in front of the chest, arm chopping down sharply"),
    (r"punch|box|thrust", "{s} fist punching forward again and again"),
    (
        r"wild|flail|windmill|\bround and round|circl",
        "{s} arm waving wildly in big loose arcs",
    ),
    (
        r"elbow.*(?:\bup|high|rais|lift)",
        "{s} elbow raised out to the side, elbow bent sharply, hand at chest height",
    ),
    (
        r"swing\w* .*\bless\b|\bless\b.*swing",
        "{s} arm swinging very little",
    ),
    (
        r"swing\w* .*(?:more|too|much|widely|wide|high|hard|big|strong|exaggerat|broad|far|a lot)|(?:wide|big|broad|exaggerat|strong)\w* .*swing",
        "{s} arm swinging widely",
    ),
    (
        r"swing\w* .*(?:little|slight|gentl|soft|small|barely|hardly)|(?:little|slight|barely|hardly|small)\w* .*swing",
        "{s} arm swinging very little",
    ),
    (r"pump", "{s} arm pumping briskly forward and back, elbow bent at a right angle"),
    (
        r"(?:diagonal|up and out|out and up|up to the side|half up)",
        "{s} arm raised up and out to the side",
    ),
    (
        r"like (?:a )?(?:bird'?s? |plane'?s? )?wings?|(?:out )?to (?:the|both|his|her) sides?\b(?<!at the sides)|sideways|sideward|spread|t-pose|wide open|\bapart\b|\bwide\b|stretched out(?! in| for)|\bout$",
        (
            "{s} arm spread a little to the side",
            "{s} arm stretched straight out to the side at shoulder height",
            "{s} arm stretched straight out to the side at shoulder height",
        ),
    ),
    (
        r"(?:backward|back|behind|trailing)",
        "{s} arm stretched back behind the body",
    ),
    (
        r"in front|forward|outstretched|reach|stretch|extend|groping|feeling|zombie|\bahead\b|point",
        (
            "{s} arm lifted a little in front, hand at hip height",
            "{s} arm stretched straight out in front at shoulder height",
            "{s} arm stretched straight out in front at shoulder height",
        ),
    ),
    (
        r"\brais|\blift|\bup\b|\bheld high|\bhigh\b|salut",
        (
            "{s} arm lifted a little in front, hand at hip height",
            "{s} arm raised overhead",
            "{s} arm raised straight up above the head",
        ),
    ),
    (r"relax(?!ed)|loosen", "{s} arm hanging at the side, swinging naturally"),
    (r"clench|fist|tense|tight", "{s} fist clenched beside the hip, elbow slightly bent, arm tense"),
    (r"\bswing|sway", "{s} arm hanging at the side, swinging naturally"),
    (r"limp|dangl|slack|loose|lifeless|droop|flopp|\bhang(?!.*straight)", "{s} arm hanging limp at the side"),
    (
        r"hang|motionless|\bstill\b|\bstiff|rigid|glued|pressed|pinned|close|straight down|at (?:the |his |her |their )?sides?|relaxed|lower|drop|down\b",
        "{s} arm hanging straight down, not swinging",
    ),
    (
        r"\bbent\b|\bbend|tucked|right angle|carry|hold|held|gripp",
        (
            "{s} arm hanging at the side, elbow slightly bent, swinging naturally",
            "{s} elbow bent at a right angle, forearm level in front",
            "{s} elbow bent sharply, hand at chest height",
        ),
    ),
    (r"straight", "{s} arm straight, elbow not bending, swinging stiffly"),
    (r"shak|trembl|twitch|fidget", "{s} elbow bent, hand trembling in front of the waist"),
)

LEG_ACTIONS: Actions = (
    (r"tip-?toe|on .*toes|heels? (?:raised|up|off|lifted|high)", "{s} foot on tiptoe, heel raised"),
    (r"on (?:the |his |her |their )?heels", "{s} leg stepping on the heel, toes raised off the ground"),
    (
        r"turned in|turns?  ?in\b|pigeon|inward|pointing in|toes? in\b",
        "{s} foot turned inward, pigeon-toed",
    ),
    (
        r"turned out|turns?  ?out|outward|pointing out|splay|toes? out\b|duck",
        "{s} foot turned outward",
    ),
    (
        r"limp|lame|injur|wound|hurt|sprain|hobbl|twisted|sore|bad\b|broken|aching|painful",
        (
            "limping slightly on the {s} leg",
            "limping on the {s} leg, hip dropping at its step",
            "limping heavily on the {s} leg, hardly standing on it",
        ),
    ),
    (r"drag|trail|shuffl|slid|scuff", "{s} foot dragging over the ground"),
    (
        r"stiff|straight|wooden|rigid|lock",
        "{s} leg stiff and straight, knee not bending, foot swinging forward",
    ),
    (r"kick", "{s} leg kicking out in front at every step, knee straight"),
    (
        r"crouch|squat|\bbent\b|\bbend|soft|\blow\b",
        (
            "{s} knee slightly bent",
            "{s} knee bent, walking crouched",
            "{s} knee bent deeply, crouching low",
        ),
    ),
    (r"(?:lift|rais|high).*\bless\b|\bless (?:high|lift)", "{s} foot lifted barely"),
    (
        r"high|lift|rais|up\b|goose",
        (
            "{s} foot lifted clearly at every step",
            "{s} knee lifted high at every step",
            "{s} knee lifted high at every step",
        ),
    ),
    (
        r"wide|apart|spread|bow-?leg",
        (
            "{s} foot placed wide to the side",
            "{s} leg spread apart, wide stance",
            "{s} leg spread very wide apart",
        ),
    ),
    (
        r"cross|scissor|overlap|catwalk|model",
        "{s} leg crossing in front of the other at every step",
    ),
    (
        r"one line|on a line|tightrope|in line|in front of (?:the|each) other",
        "{s} foot placed exactly in front of the other, feet on one line",
    ),
    (
        r"together|narrow|close",
        "{s} foot placed on one line, narrow stance",
    ),
    (
        r"stomp|stamp|slam|pound",
        (
            "{s} leg stepping heavily, foot hitting the ground hard",
            "{s} leg stomping, foot slammed down hard at every step",
            "{s} leg stomping very heavily like a giant",
        ),
    ),
    (
        r"heav|lead\b|clomp|clump|thud|plod",
        (
            "{s} leg treading heavily",
            "{s} leg stepping heavily, foot hitting the ground hard",
            "{s} leg stomping, foot slammed down hard at every step",
        ),
    ),
    (r"\bsoft|gentl|\blight|quiet|silent|noiseless|without a sound", "{s} leg stepping lightly and softly"),
    (r"stagger|reel|stumbl|lurch", "{s} leg staggering, steps going astray to both sides"),
    (
        r"hesitat|paus|halt",
        (
            "{s} leg stepping hesitantly",
            "{s} leg pausing after every step",
            "{s} leg pausing after every step",
        ),
    ),
    (r"still|planted|standing|motionless", "{s} leg standing still, knee straight"),
    (
        r"(?:tiny|short|small|little|baby|minc).*(?:quick|fast|hurr|rapid|brisk)|(?:quick|fast|hurr|rapid|brisk).*(?:tiny|short|small|little|baby)|minc|patter|tripping|scurr",
        "{s} leg taking tiny hurried steps",
    ),
    (
        r"(?:long|big|giant|large|huge|strid).*slow|slow.*(?:long|big|giant|large|huge|strid)",
        "{s} leg taking very long slow strides",
    ),
    (r"giant|huge|enormous", "{s} leg taking giant slow steps"),
    (
        r"short|small|tiny|baby|little steps",
        (
            "{s} leg taking rather short steps",
            "{s} leg taking short steps",
            "{s} leg taking very short and very quick steps",
        ),
    ),
    (
        r"long|big|large|strid",
        (
            "{s} leg taking rather long steps",
            "{s} leg taking long strides",
            "{s} leg taking very long slow strides",
        ),
    ),
    (r"quick|fast|hurr|brisk|rapid", "{s} leg stepping quickly, steps of normal length"),
    (r"slow|leisure|unhurried", "{s} leg stepping slowly, steps of normal length"),
    (r"bounc|spring|hop|skip|jump", "{s} leg stepping lightly with a bounce, foot springing off the toes"),
    (
        r"wobbl|unstead|shak|buckl|weak|trembl",
        "{s} leg unsteady, knee buckling at every step, foot placed wide",
    ),
)

TORSO_ACTIONS: Actions = (
    (r"hip.*(?:forward|in front|\bout\b)", "torso leaning backward, belly forward"),
    (r"hip.*\bback", "torso leaning forward, hips pushed back"),
    (r"hollow back|arched back|back arched|back hollow|\barch", "chest pushed out, back arched"),
    (
        r"(?:lean|bent|bend|tilt|tip|arch)\w*\b.*\bback(?:wards?)?\b",
        ("torso leaning slightly back", "torso leaning back", "torso leaning far back"),
    ),
    (
        r"(?:lean|tilt|bent|bend|tip)\w* .*\bleft\b",
        ("torso leaning to the left", "torso leaning to the left", "torso leaning far to the left"),
    ),
    (
        r"(?:lean|tilt|bent|bend|tip)\w* .*\bright\b",
        ("torso leaning to the right", "torso leaning to the right", "torso leaning far to the right"),
    ),
    (r"double", "torso leaning far forward"),
    (
        r"slump|droop|sag|sunken|cav|hunch|stoop|round|slouch|crook|curv",
        "back rounded, shoulders hunched forward",
    ),
    (
        r"lean|pitch|forward|tilt|tip|bent|bend|bow",
        ("torso leaning slightly forward", "torso leaning forward", "torso leaning far forward"),
    ),
    (
        r"hip.*(?:swing\w* round|twist|rotat|turn)|(?:twist|rotat|turn)\w* .*hip",
        (
            "hips twisting forward at every step",
            "hips swinging round with every step",
            "hips swinging far round with every step",
        ),
    ),
    (
        r"hip.*(?:sway|swing|roll|wiggl|sashay)|(?:sway|swing|roll|wiggl|sashay)\w* .*hip",
        (
            "hips swaying slightly from side to side",
            "hips swaying from side to side with every step",
            "hips swaying widely from side to side",
        ),
    ),
    (
        r"shoulder.*(?:sway|roll|swagger)|(?:roll|sway)\w* .*shoulder|swagger",
        (
            "shoulders rolling with the steps",
            "shoulders rolling widely with a swagger",
            "shoulders rolling widely with a swagger",
        ),
    ),
    (
        r"shoulder.*(?:swing|turn|twist)|(?:swing|turn|twist)\w* .*shoulder",
        (
            "shoulders turning a little with the steps",
            "shoulders swinging round with every step",
            "shoulders twisting strongly with the steps",
        ),
    ),
    (r"stagger|reel|lurch|off balance", "torso staggering from one side to the other"),
    (
        r"^(?!hip).*(?:\bdrop|\blower|\bdown\b|\brelax|loosen)",
        "torso upright and relaxed, shoulders loose and level",
    ),
    (
        r"rais|shrug|tens|lift(?!ed chest)|\bup\b|tight",
        "torso tense, shoulders raised towards the ears",
    ),
    (
        r"pulled back|drawn back|held back|\bback$|broad|puff|\bout\b|proud|squared",
        "chest pushed out, back arched",
    ),
    (r"shak|shiver|trembl", "torso tense, shoulders raised and trembling"),
    (
        r"twist|rotat|turn|swing",
        "shoulders twisting strongly with the steps",
    ),
    (
        r"rock|waddl|side to side|sway|roll|wobbl",
        (
            "torso rocking slightly from side to side",
            "torso rocking from side to side with every step",
            "torso rocking heavily from side to side",
        ),
    ),
    (r"stiff|rigid|still", "torso upright and stiff, held still"),
    (r"straight|upright|erect|tall", "torso upright, back straight"),
    (
        r"bounc|bob",
        (
            "torso bobbing a little with the steps",
            "torso bouncing up and down with every step",
            "torso bobbing clearly at every step",
        ),
    ),
    (r"level|glid|float", "torso gliding level, not rising or falling"),
    (r"relax|loose|soft", "torso upright and relaxed, shoulders loose and level"),
)

HEAD_ACTIONS: Actions = (
    (
        r"\bleft\b.*\bright\b|\bright\b.*\bleft\b|around|about|side to side|everywhere|searching",
        "head turning left and right, looking around",
    ),
    (
        r"over .*shoulder|behind|backwards",
        "head turned to the left, looking back over the shoulder",
    ),
    (r"(?:tilt|lean|cock|bent)\w* .*\bleft\b", "head tilted to the left shoulder"),
    (r"(?:tilt|lean|cock|bent)\w* .*\bright\b", "head tilted to the right shoulder"),
    (r"\bleft\b", "head turned to the left"),
    (r"\bright\b", "head turned to the right"),
    (r"hang|droop|drop|loll.*down|chest\b", "head hanging low, chin on the chest"),
    (
        r"down|low|bow|sunk|floor|ground|feet|phone|book|hands|tuck|ashamed|toes|shoes",
        (
            "head slightly lowered",
            "head down, looking at the ground",
            "head hanging low, chin on the chest",
        ),
    ),
    (r"bob|nod|peck", "head nodding up and down"),
    (r"shak", "head shaking quickly from side to side"),
    (r"roll|loll|wobbl|sway", "head lolling loosely from side to side"),
    (
        r"thrown back|\bback\b|\bsky\b|ceiling|clouds|stars",
        "head thrown back, looking at the sky",
    ),
    (
        r"\bup\b|upwards?|high|rais|lift|in the air",
        ("head slightly raised", "head raised, chin up", "head thrown back, looking at the sky"),
    ),
    (r"tilt|cock|lean", "head tilted to the left shoulder"),
    (r"jut|thrust|poked|stretched|out\b|forward(?! and)", "head pushed forward, neck stretched"),
    (r"turn", "head turning left and right, looking around"),
    (
        r"still|steady|straight|level|upright|ahead|erect|stiff|motionless|tall",
        "head upright and still, looking straight ahead",
    ),
)

# What a part does when an action is denied: "without bending the knees", "not looking down".
ARM_DENIED: Actions = (
    (r"swing|mov|sway", "{s} arm hanging straight down, not swinging"),
    (r"bend|bent", "{s} arm straight, elbow not bending, swinging stiffly"),
    (r"rais|lift|\bup\b|overhead|wav", "{s} arm hanging straight down, not swinging"),
    (r"", "{s} arm hanging at the side, swinging naturally"),
)
LEG_DENIED: Actions = (
    (r"drag|shuffl|scuff|slid", "{s} foot lifted clearly at every step"),
    (r"bend|bent", "{s} leg stiff and straight, knee not bending, foot swinging forward"),
    (r"lift|leav|rais|off", "{s} foot dragging over the ground"),
    (r"", "{s} leg stepping evenly, knee lifting moderately, foot rolling from heel to toe"),
)
TORSO_DENIED: Actions = (
    (r"bounc|bob", "torso gliding level, not rising or falling"),
    (r"hip", "torso with still hips, hips neither swaying nor turning"),
    (r"shoulder", "torso with still shoulders, hardly turning"),
    (r"mov|turn|twist|sway|swing|bounc|rock", "torso upright and stiff, held still"),
    (r"", "torso upright, back straight"),
)
HEAD_DENIED: Actions = (
    (r"\bup\b|upwards?|\brais|\blift|\bsky\b|ceiling", "head slightly lowered"),
    (r"mov|turn|nod|shak|bob", "head upright and still, looking straight ahead"),
    (r"", "head upright, looking straight ahead"),
)
