using System;
using UnityEngine;
using UnityEngine.Events;

namespace Terraport.Unity
{
    /// <summary>
    /// A scene of a terraport service: its base mesh, always there, and full detail within a radius of the newest landing. The
    /// transform of its object is the place of the scene's origin: X east, Y up, Z north, metres.
    /// </summary>
    /// <remarks>
    /// Opened when enabled with an address, closed when disabled; everything that it made is freed then. All members belong to the main thread, and
    /// events are raised on it, from Update. Nothing blocks.
    /// </remarks>
    [AddComponentMenu("Terraport/Terraport Scene")]
    [DisallowMultipleComponent]
    [ExecuteAlways]
    public sealed partial class TerraportScene : MonoBehaviour
    {
        // Serialized fields are what the inspector shows; properties below are for code. The token is none of them: it must not be saved.
        [SerializeField]
        [Tooltip("Address of the scene: http(s)://host/scenes/ID.")]
        private string sceneUrl = "";

        [SerializeField]
        [Tooltip("Open when the component is enabled, if it has an address. Off: call Open.")]
        private bool openOnEnable = true;

        [SerializeField]
        [Tooltip("Show the base in the scene view while nothing is played, and a landing below its camera. Nothing of it is saved.")]
        private bool previewInEditor;

        [SerializeField]
        private TerraportSettings settings = new TerraportSettings();

        [SerializeField]
        [Tooltip(
            "Material for detail; none takes this package's own. It is drawn with vertex colours (linear) or a photograph (_MainTex).")]
        private Material detailMaterial;

        [SerializeField]
        [Tooltip("Material for the base; none takes this package's own, which pushes it back behind the detail.")]
        private Material baseMaterial;

        [SerializeField]
        [Tooltip("A landing was shown, all of it.")]
        private UnityEvent onShown = new UnityEvent();

        [SerializeField]
        [Tooltip("The deadline passed on a slow link: the inner part can be shown, the rest follows.")]
        private UnityEvent onDegraded = new UnityEvent();

        [SerializeField]
        [Tooltip("Something failed; the text says what. What is shown stays.")]
        private UnityEvent<string> onFailed = new UnityEvent<string>();

        // Null while the scene is closed.
        private SceneSession session;
        // The session whose Update runs: a listener may close it from within, and it must not be disposed of under its feet.
        private SceneSession updating;
        private string token;
        private LinkState link = new LinkState();
        // The newest Land before the scene was loaded.
        private bool hasPendingLanding;
        private Vec3 pendingPosition;
        private double pendingRadiusM;
        private LandOptions pendingOptions;

        /// <summary>The files of a scene version are here; the base is drawn a few frames later.</summary>
        public event Action<SceneFiles> Loaded;

        /// <summary>A landing was planned: what comes, and what a budget left out.</summary>
        public event Action<PlanFacts> Planned;

        /// <summary>Every byte of a landing (its number) is here and verified; it is shown a few frames later.</summary>
        public event Action<int> Ready;

        /// <summary>The deadline of a landing passed: its inner part can be shown.</summary>
        public event Action<int> Degraded;

        /// <summary>What is drawn has changed, in this frame.</summary>
        public event Action<SceneSwap> Shown;

        /// <summary>
        /// With <see cref="AutoShow"/> off: the landing of this number (its inner part at first, where its deadline passed) can be shown, by
        /// <see cref="Show"/>.
        /// </summary>
        public event Action<int> Presentable;

        /// <summary>A pick was answered: its number, and what was met; null for nothing, or where it was refused.</summary>
        public event Action<int, PickHit> Picked;

        /// <summary>The connection changed: connecting, open, waiting, or closed for good.</summary>
        public event Action<LinkState> LinkChanged;

        /// <summary>
        /// Something failed: files that cannot be loaded, a landing refused, a segment that cannot be drawn (its base stays), a
        /// connection closed for good. What is shown stays.
        /// </summary>
        public event Action<TerraportException> Failed;

        /// <summary>Every event of the stream, for what has no event of its own.</summary>
        public event StreamEventHandler Streamed;

        /// <summary>Address of the scene: http(s)://host/scenes/ID. Counts when it is opened.</summary>
        public string SceneUrl
        {
            get {
                return sceneUrl;
            }
            set {
                sceneUrl = value;
            }
        }

        /// <summary>
        /// Bearer token; null for a service that asks for none. Never saved with the scene: set it from code, before Open or with
        /// <see cref="Reconnect"/>.
        /// </summary>
        public string Token
        {
            get {
                return token;
            }
            set {
                token = value;
            }
        }

        /// <summary>
        /// Asked for the present token before each connection and each loading, in place of <see cref="Token"/>: a session then outlives
        /// its tokens. Null without. Counts when it is opened.
        /// </summary>
        /// <remarks>
        /// Called on the main thread and on the stream's: it returns at once what it has, and touches nothing of the engine. Ask your
        /// server for the next token before the present one ends.
        /// </remarks>
        public Func<string> TokenProvider { get; set; }

        /// <summary>How it is loaded and drawn. Counts when it is opened, frame budget apart.</summary>
        public TerraportSettings Settings => settings;

        /// <summary>The project's own material for detail; null takes this package's. Counts when it is opened.</summary>
        public Material DetailMaterial
        {
            get {
                return detailMaterial;
            }
            set {
                detailMaterial = value;
            }
        }

        /// <summary>The project's own material for the base; null takes this package's. Counts when it is opened.</summary>
        public Material BaseMaterial
        {
            get {
                return baseMaterial;
            }
            set {
                baseMaterial = value;
            }
        }

        /// <summary>Makes the connections; null takes this package's. Counts when it is opened.</summary>
        public ITransportFactory Transports { get; set; }

        /// <summary>Loads the files; null takes this package's. Counts when it is opened.</summary>
        public IHttp Http { get; set; }

        /// <summary>Whether it was opened and not closed.</summary>
        public bool IsOpen => session != null;

        /// <summary>Files of the version that is served now; null until they are here.</summary>
        public SceneFiles Files => session == null ? null : session.Files;

        /// <summary>Null until the files are here: for what goes with a scene, as <see cref="TerraportGroup"/>.</summary>
        internal SceneStage Stage => session == null ? null : session.Stage;

        internal ISceneStream Stream => session == null ? null : session.Stream;

        /// <summary>Where the connection stands.</summary>
        public LinkState Link => link;

        /// <summary>Where the newest landing stands.</summary>
        public LandingStatus Status => session == null || session.Stage == null ? default(LandingStatus) : session.Stage.Status;

        /// <summary>Radius of a landing for which none is given, metres.</summary>
        public float DefaultRadiusM => session != null ? session.RadiusM : settings.ActualBudgets.radiusM;

        /// <summary>Counts for a display: segments, objects, triangles, bytes; allocates, so not for every frame.</summary>
        public SceneFigures Figures
        {
            get {
                SceneFigures figures = default(SceneFigures);
                figures.Stream = new StreamStats();
                if (session != null)
                {
                    figures.Segments = session.Renderer.SegmentCount;
                    figures.Objects = session.Renderer.ObjectCount;
                    figures.DrawnTriangles = session.Renderer.DrawnTriangles;
                    figures.Stream = session.Stream == null ? figures.Stream : session.Stream.Stats;
                }
                return figures;
            }
        }

        /// <summary>Load the scene and connect; nothing where it is open. Closes itself when the component is disabled.</summary>
        public void Open()
        {
            if (session != null)
            {
                return;
            }
            // Asked once, here: later every single upload would fail.
            if (!MeshFiller.IsSupported)
            {
                Fail(new TerraportException("unsupported", "this graphics card does not read 16-bit colours or 8-bit normals"));
                return;
            }
            try
            {
                session = new SceneSession(this, sceneUrl, token);
            }
            catch (TerraportException error)
            {
                Fail(error);
                return;
            }
            // Subscribed after the constructor: it only begins to load, and nothing is raised before the first Update.
            session.Faulted += Fail;
            session.Loaded += OnLoaded;
            session.Streamed += OnStreamed;
            session.Swapped += OnSwapped;
            session.Presentable += OnPresentable;
        }

        /// <summary>Disconnect and free everything. What was shown is gone.</summary>
        public void Close()
        {
            if (session != null)
            {
                SceneSession closing = session;
                // First: a listener that looks at the scene finds it closed.
                session = null;
                closing.Faulted -= Fail;
                closing.Loaded -= OnLoaded;
                closing.Streamed -= OnStreamed;
                closing.Swapped -= OnSwapped;
                closing.Presentable -= OnPresentable;
                if (closing != updating)
                {
                    closing.Dispose();
                }
                // Else a listener called: it is disposed of when its Update has come to an end.
            }
            hasPendingLanding = false;
            link = new LinkState();
        }

        /// <summary>
        /// Land: full detail within a radius of a point comes, and is then shown in one frame. Supersedes a landing that is not ready.
        /// Before the scene is loaded the newest call is kept until it is.
        /// </summary>
        /// <param name="point">Where, in Unity's world.</param>
        /// <param name="radiusM">Metres of the scene; 0 takes <see cref="DefaultRadiusM"/>.</param>
        /// <param name="options">Inner radius, deadline, stall; null leaves them to the server.</param>
        /// <returns>Number of the landing in the events; 0 where it waits for the scene to be loaded.</returns>
        public int Land(Vector3 point, float radiusM = 0, LandOptions options = null)
        {
            // Turned into the scene's frame at once: the object may be moved before the scene is loaded.
            Vec3 position = ToScene(point);
            // The scene's transform may be scaled; the radius is in metres of the scene, as the server counts.
            double radius = radiusM > 0 ? radiusM : DefaultRadiusM;
            if (session == null || session.Stage == null)
            {
                hasPendingLanding = true;
                pendingPosition = position;
                pendingRadiusM = radius;
                pendingOptions = options;
                return 0;
            }
            return session.Stage.Land(position, radius, options);
        }

        /// <summary>Tell where the user points: what a landing there would need is loaded ahead. Cheap; call it in every frame.</summary>
        /// <param name="point">Where, in Unity's world.</param>
        /// <param name="radiusM">Metres of the scene; 0 takes <see cref="DefaultRadiusM"/>.</param>
        public void Aim(Vector3 point, float radiusM = 0)
        {
            if (session != null && session.Stage != null)
            {
                session.Stage.Aim(ToScene(point), radiusM > 0 ? radiusM : DefaultRadiusM);
            }
        }

        /// <summary>
        /// Show a landing as soon as it can be drawn; may be changed at any time. Switch it off to show it in the dark of a fade, by
        /// <see cref="Show"/>: <see cref="TerraportTeleport"/> does so.
        /// </summary>
        public bool AutoShow
        {
            get {
                return settings.autoShow;
            }
            set {
                settings.autoShow = value;
                if (session != null && session.Stage != null)
                {
                    session.Stage.AutoShow = value;
                }
            }
        }

        /// <summary>
        /// Show the newest landing: in this frame where it can be shown, else in the first in which it can. Needed without
        /// <see cref="TerraportSettings.autoShow"/> alone. True where it was shown now.
        /// </summary>
        public bool Show() { return session != null && session.Stage != null && session.Stage.Show(); }

        /// <summary>Ask the server what full detail has above and below a point of Unity's world. Answered by <see cref="Picked"/>.</summary>
        /// <returns>Number of the request; 0 before the scene is loaded.</returns>
        public int Pick(Vector3 point) { return session == null || session.Stream == null ? 0 : session.Stream.Pick(ToScene(point)); }

        /// <summary>Ask the server what full detail has along a ray of Unity's world. Answered by <see cref="Picked"/>.</summary>
        /// <returns>Number of the request; 0 before the scene is loaded.</returns>
        public int Pick(Ray ray)
        {
            if (session == null || session.Stream == null)
            {
                return 0;
            }
            // As a vector, with the scale: a stretched scene bends directions. The protocol takes any length.
            Vector3 direction = transform.InverseTransformVector(ray.direction);
            return session.Stream.Pick(ToScene(ray.origin), Axes.Turn(new Vec3(direction.x, direction.y, direction.z)));
        }

        /// <summary>Connect now, perhaps with another token: after the connection was closed for good, or to cut a wait short.</summary>
        /// <remarks>A token that is given here stands for <see cref="TokenProvider"/> from now on.</remarks>
        public void Reconnect(string newToken = null)
        {
            if (!string.IsNullOrEmpty(newToken))
            {
                token = newToken;
                TokenProvider = null;
            }
            if (session == null)
            {
                Open();
                return;
            }
            session.Reconnect(newToken);
        }

        /// <summary>The position in the scene's frame (x east, y up, z south, metres) of a point of Unity's world.</summary>
        public Vec3 ToScene(Vector3 point)
        {
            // The object's transform first, then the axes: the scene's origin may lie, turn and scale anywhere in Unity's world.
            Vector3 local = transform.InverseTransformPoint(point);
            return Axes.Turn(new Vec3(local.x, local.y, local.z));
        }

        /// <summary>The point of Unity's world of a position in the scene's frame.</summary>
        public Vector3 ToWorld(Vec3 position)
        {
            Vec3 local = Axes.Turn(position);
            return transform.TransformPoint(new Vector3((float)local.X, (float)local.Y, (float)local.Z));
        }

        private void OnEnable()
        {
            if (!Application.isPlaying)
            {
                BeginPreview();
                return;
            }
            if (openOnEnable && !string.IsNullOrEmpty(sceneUrl))
            {
                Open();
            }
        }

        private void OnDisable()
        {
            if (!Application.isPlaying)
            {
                EndPreview();
                return;
            }
            Close();
        }

        private void OnApplicationPause(bool isPaused)
        {
            // A headset that is put on again: what broke meanwhile is not waited for, as after a failure.
            if (!isPaused && session != null && link.Phase == LinkPhase.Waiting)
            {
                session.Reconnect(null);
            }
        }

        private void Update()
        {
            // The editor calls it when anything in the scene changes; what is previewed goes at a pace of its own.
            if (Application.isPlaying)
            {
                Step();
            }
        }

        private void Step()
        {
            if (session == null)
            {
                return;
            }
            updating = session;
            try
            {
                updating.Update();
            }
            finally
            {
                SceneSession updated = updating;
                updating = null;
                if (updated != session)
                {
                    // Closed by one of its own listeners: now nothing of it is on the call stack any more.
                    updated.Dispose();
                }
            }
        }
    }
}
