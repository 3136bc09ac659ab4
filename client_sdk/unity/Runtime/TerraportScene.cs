using System;
using System.Collections.Generic;
using UnityEngine;
using UnityEngine.Events;

namespace Terraport.Unity
{
    /// <summary>
    /// A scene of a terraport service: its base mesh, always there, and full detail within a radius of the newest landing. The
    /// transform of its object is the place of the scene's origin: X east, Y up, Z north, metres.
    /// </summary>
    /// <remarks>
    /// Opened when enabled with an address, closed when disabled; everything that it made is freed then. All members belong to the main
    /// thread, and events are raised on it, from Update. Nothing blocks.
    /// </remarks>
    [AddComponentMenu("Terraport/Terraport Scene")]
    [DisallowMultipleComponent]
    [ExecuteAlways]
    public sealed partial class TerraportScene : MonoBehaviour
    {
        // Serialized fields are what the inspector shows. The token is none of them: it must not be saved.
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
        [Tooltip("Material for detail; none takes this package's own. It is drawn with vertex colours (linear) or an image (_MainTex).")]
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

        // Null while the scene is closed. The other one runs its Update: a listener may close it from within.
        private SceneSession session, updating;
        // The newest Land before the scene was loaded.
        private Action pendingLanding;
        // The visit whose events are raised.
        private SceneClient wired;

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
        /// Something failed: files that cannot be loaded, a landing refused, a segment that cannot be drawn (its base stays), a connection
        /// closed for good. What is shown stays.
        /// </summary>
        public event Action<TerraportException> Failed;

        /// <summary>Address of the scene: http(s)://host/scenes/ID. Counts when it is opened.</summary>
        public string SceneUrl
        {
            get => sceneUrl;
            set => sceneUrl = value;
        }

        /// <summary>Bearer token; null for a service that asks for none. Never saved: set it from code, before Open or by <see cref="Reconnect"/>.</summary>
        public string Token { get; set; }

        /// <summary>
        /// Asked for the present token before each connection and each loading, instead of <see cref="Token"/>: a session then outlives its
        /// tokens. Null without. It returns at once what it has: ask your server for the next token before the present one ends.
        /// </summary>
        public Func<string> TokenProvider { get; set; }

        /// <summary>How it is loaded and drawn. Counts when it is opened, the frame budget apart.</summary>
        public TerraportSettings Settings => settings;

        /// <summary>The project's own material for detail; null takes this package's. Counts when it is opened.</summary>
        public Material DetailMaterial
        {
            get => detailMaterial;
            set => detailMaterial = value;
        }

        /// <summary>The project's own material for the base; null takes this package's. Counts when it is opened.</summary>
        public Material BaseMaterial
        {
            get => baseMaterial;
            set => baseMaterial = value;
        }

        /// <summary>Whether it was opened and not closed.</summary>
        public bool IsOpen => session != null;

        /// <summary>Files of the version that is served now; null until they are here.</summary>
        public SceneFiles Files => Client?.Files;

        /// <summary>State of the connection.</summary>
        public LinkState Link { get; private set; }

        /// <summary>State of the newest landing.</summary>
        public LandingStatus Status => Client?.Status ?? default;

        /// <summary>Radius of a landing for which none is given, metres.</summary>
        public float DefaultRadiusM => session?.RadiusM ?? settings.ActualBudgets.radiusM;

        /// <summary>Show a landing as soon as it can be drawn. Off: show it in the black of a fade, by <see cref="Show"/>.</summary>
        public bool AutoShow
        {
            get => settings.autoShow;
            set {
                settings.autoShow = value;
                if (Client != null) Client.AutoShow = value;
            }
        }

        /// <summary>Landings and aims from now on ask for a ring of the coarser level around full detail, where the scene has one.</summary>
        public bool ShowsCoarse
        {
            get => settings.showsCoarse;
            set {
                settings.showsCoarse = value;
                if (Client != null) Client.ShowsCoarse = value;
            }
        }

        /// <summary>Counts for a display; allocates, so not for every frame.</summary>
        public SceneFigures Figures => session == null ? default
                                                       : new SceneFigures {
                                                             Segments = Client?.ResidentCount ?? 0,
                                                             Objects = session.Renderer.ObjectCount,
                                                             DrawnTriangles = session.Renderer.DrawnTriangles,
                                                             Stream = Client?.Stats ?? default,
                                                         };

        /// <summary>Null until the files are here.</summary>
        internal SceneClient Client => session?.Client;

        /// <summary>What is shown; null until the files are here.</summary>
        internal ShownGround Ground => Client?.Ground;

        /// <summary>Load the scene and connect; nothing where it is open.</summary>
        public void Open()
        {
            if (session != null) return;
            if (!MeshFiller.IsSupported)
            {
                Fail(new TerraportException("unsupported", "this graphics card does not read 16-bit colours or 8-bit normals"));
                return;
            }
            try
            {
                session = new SceneSession(this, () => TokenProvider == null ? Token : TokenProvider());
            }
            catch (TerraportException error)
            {
                Fail(error);
                return;
            }
            SceneSession opened = session;
            opened.Failed += Fail;
            opened.Loaded += files => OnLoaded(opened, files);
        }

        /// <summary>Disconnect and free everything. What was shown is gone.</summary>
        public void Close()
        {
            SceneSession closing = session;
            // First: a listener that looks at the scene finds it closed.
            session = null;
            // One that is updating is disposed of when its Update has come to an end.
            if (closing != null && closing != updating) closing.Dispose();
            pendingLanding = null;
            Link = default;
        }

        /// <summary>
        /// Land: full detail within a radius of a point comes, and is then shown in one frame. Supersedes a landing that is not shown.
        /// Before the scene is loaded the newest call is kept until it is.
        /// </summary>
        /// <param name="point">Where, in Unity's world.</param>
        /// <param name="radiusM">Metres of the scene; 0 takes <see cref="DefaultRadiusM"/>.</param>
        /// <param name="options">Further radii; null for none.</param>
        /// <returns>Number of the landing in the events; 0 where it waits for the scene to be loaded.</returns>
        /// <exception cref="ArgumentException">A radius or position that cannot be.</exception>
        public int Land(Vector3 point, float radiusM = 0, LandOptions options = null)
        {
            // Converted at once: the object may be moved before the scene is loaded.
            Vec3 position = ToScene(point);
            double radius = radiusM > 0 ? radiusM : DefaultRadiusM;
            if (Client != null) return Client.Land(position, radius, options);
            pendingLanding = () => Client.Land(position, radius, options);
            return 0;
        }

        /// <summary>Tell where the user points: what a landing there needs is loaded ahead. Cheap; call it in every frame.</summary>
        public void Aim(Vector3 point, float radiusM = 0) { Client?.Aim(ToScene(point), radiusM > 0 ? radiusM : DefaultRadiusM); }

        /// <summary>
        /// Show the newest landing: in this frame where it can be shown, else in the first in which it can. Needed with
        /// <see cref="AutoShow"/> off. True where it was shown now.
        /// </summary>
        public bool Show() { return Client != null && Client.Show(); }

        /// <summary>Ask the service what full detail has above and below a point. Answered by <see cref="Picked"/>.</summary>
        /// <returns>Number of the request; 0 before the scene is loaded.</returns>
        public int Pick(Vector3 point) { return Client?.Pick(ToScene(point), null) ?? 0; }

        /// <summary>Ask the service what full detail has along a ray. Answered by <see cref="Picked"/>.</summary>
        /// <returns>Number of the request; 0 before the scene is loaded.</returns>
        public int Pick(Ray ray) { return Client?.Pick(ToScene(ray.origin), DirectionOf(ray)) ?? 0; }

        /// <summary>Connect now, perhaps with another token: after the connection was closed for good, or to cut a wait short.</summary>
        /// <remarks>A token that is given here counts instead of <see cref="TokenProvider"/> from now on.</remarks>
        public void Reconnect(string newToken = null)
        {
            newToken = string.IsNullOrEmpty(newToken) ? null : newToken;
            if (newToken != null)
            {
                Token = newToken;
                TokenProvider = null;
            }
            if (session == null)
                Open();
            else
                session.Reconnect(newToken);
        }

        /// <summary>The position in the scene's frame (x east, y up, z south, metres) of a point of Unity's world.</summary>
        public Vec3 ToScene(Vector3 point)
        {
            Vector3 local = transform.InverseTransformPoint(point);
            return Axes.Turn(new Vec3(local.x, local.y, local.z));
        }

        /// <summary>The point of Unity's world of a position in the scene's frame.</summary>
        public Vector3 ToWorld(Vec3 position)
        {
            Vec3 local = Axes.Turn(position);
            return transform.TransformPoint(new Vector3((float)local.X, (float)local.Y, (float)local.Z));
        }

        /// <summary>The first point of what is shown along a ray of Unity's world. Exact; a fraction of a millisecond.</summary>
        public bool CastGround(Ray ray, float reachM, out GroundHit hit)
        {
            GroundPoint point = default;
            bool isMet = Ground != null && Ground.Cast(ToScene(ray.origin), DirectionOf(ray), reachM, out point);
            hit = isMet ? HitOf(point) : default;
            return isMet;
        }

        /// <summary>Ground of what is shown on the vertical through a point: the highest not above it, else the lowest above it.</summary>
        /// <remarks>For feet ask from the knee: a user on a step would else fall through what rises in front.</remarks>
        public bool GroundAt(Vector3 place, out GroundHit hit)
        {
            GroundPoint point = default;
            bool isMet = Ground != null && Ground.At(ToScene(place), out point);
            hit = isMet ? HitOf(point) : default;
            return isMet;
        }

        /// <summary>The named regions, by name, the largest of each name first; empty before the scene is loaded.</summary>
        public IReadOnlyList<Place> ListPlaces() { return Files == null ? new List<Place>() : Places.Of(Files.Regions); }

        /// <summary>The place of that name, whatever its case; of several the largest, null where there is none.</summary>
        public Place FindPlace(string label) { return Places.Find(ListPlaces(), label); }

        /// <summary>Where a place is in Unity's world.</summary>
        public Vector3 ToWorld(Place place) { return ToWorld(place.Position); }

        /// <summary>Coarser pieces that a region, as of a <see cref="PickHit"/>, is part of, finest first.</summary>
        public IReadOnlyList<CoarserPiece> CoarserPieces(int region)
        {
            return Files == null ? new List<CoarserPiece>() : Places.Coarser(Files.Regions, region);
        }

        // As a vector, with the scale: a stretched scene bends directions.
        private Vec3 DirectionOf(Ray ray)
        {
            Vector3 along = transform.InverseTransformVector(ray.direction);
            return Axes.Turn(new Vec3(along.x, along.y, along.z));
        }

        private GroundHit HitOf(GroundPoint point)
        {
            Vector3 place = ToWorld(point.Position);
            return new GroundHit {
                Point = place,
                Normal = ToWorld(point.Position + point.Normal) - place,
                Distance = (float)point.At,
                Segment = point.Segment,
            };
        }

        private void OnLoaded(SceneSession loaded, SceneFiles files)
        {
            if (loaded != session) return;
            SceneClient client = session.Client;
            if (wired != client) Wire(client);
            // First, since what a listener asks for is newer.
            Action landing = pendingLanding;
            pendingLanding = null;
            try
            {
                landing?.Invoke();
            }
            catch (ArgumentException error)
            {
                Fail(new TerraportException("bad_landing", error.Message, null, error));
            }
            Loaded?.Invoke(files);
        }

        private void Wire(SceneClient client)
        {
            wired = client;
            client.Planned += plan => Planned?.Invoke(plan);
            client.Ready += landing => Ready?.Invoke(landing);
            client.Presentable += landing => Presentable?.Invoke(landing);
            client.Picked += (request, hit) => Picked?.Invoke(request, hit);
            client.Failed += Fail;
            client.Degraded += landing =>
            {
                Degraded?.Invoke(landing);
                onDegraded.Invoke();
            };
            client.Shown += swap =>
            {
                Shown?.Invoke(swap);
                if (swap.Landing > 0 && !swap.IsDegraded) onShown.Invoke();
            };
            client.LinkChanged += state =>
            {
                Link = state;
                LinkChanged?.Invoke(state);
            };
        }

        private void Fail(TerraportException error)
        {
            if (Failed != null)
                Failed(error);
            else
                Debug.LogWarning("terraport: " + error.Code + ": " + error.Message, this);
            onFailed.Invoke(error.Message);
        }

        private void OnEnable()
        {
            if (!Application.isPlaying)
                BeginPreview();
            else if (openOnEnable && !string.IsNullOrEmpty(sceneUrl))
                Open();
        }

        private void OnDisable()
        {
            if (!Application.isPlaying)
                EndPreview();
            else
                Close();
        }

        private void OnApplicationPause(bool isPaused)
        {
            // A headset that is put on again: what broke meanwhile is not waited for.
            if (!isPaused && Link.Phase == LinkPhase.Waiting) session?.Reconnect(null);
        }

        private void Update()
        {
            // The editor calls it when anything in the scene changes; a preview goes at its own pace.
            if (Application.isPlaying) Step();
        }

        private void Step()
        {
            if (session == null) return;
            updating = session;
            try
            {
                updating.Update();
            }
            finally
            {
                SceneSession updated = updating;
                updating = null;
                // Closed by one of its own listeners.
                if (updated != session) updated.Dispose();
            }
        }
    }
}
