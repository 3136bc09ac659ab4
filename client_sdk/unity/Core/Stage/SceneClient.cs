using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.Linq;
using Terraport.Wire;

namespace Terraport
{
    /// <summary>
    /// A visit of a scene: session, connection, caches, decoding, and what is drawn. What is visible changes in one frame, by flags alone:
    /// meshes and the base's lists of faces are made ready before, within each frame's budget.
    /// </summary>
    /// <remarks>All calls come from the thread that draws. Events are raised within <see cref="Update"/> and <see cref="Show"/>.</remarks>
    internal sealed partial class SceneClient : IDisposable
    {
        // Times the radius: as far as the coarser level is worth its bytes (docs/benchmarks.md).
        private const double CoarseReach = 3;

        // How long the list of the disk cache is waited for before the first landing is sent.
        private const double DiskPatienceMs = 1500;

        // Decoded segments that wait to be uploaded, and bytes that one frame uploads: drivers put work off to a later frame.
        private const int MaxUploads = 16;
        private const long MaxFrameBytes = 6 << 20;

        // Sets that were shown whole and are shown again at once, where all of it is still on the graphics card.
        private const int MaxRemembered = 8;

        private readonly SceneClientOptions options;
        private readonly IGroundRenderer renderer;
        private readonly SessionCore session;
        private readonly Link link;
        private readonly DecodeQueue decoders;
        private readonly DiskCache disk;
        private readonly Stopwatch clock = Stopwatch.StartNew();
        // Raised at the end of a frame: listeners may call anything.
        private readonly Queue<Action> raised = new Queue<Action>();
        // On the graphics card, drawable or soon; and on their way there: being read, decoded or waiting to be uploaded.
        private readonly Dictionary<ulong, Resident> residents = new Dictionary<ulong, Resident>();
        private readonly HashSet<ulong> pending = new HashSet<ulong>();
        private readonly Queue<DecodeJob> uploads = new Queue<DecodeJob>();
        private readonly List<ShownSet> remembered = new List<ShownSet>();
        // Rows of the newest plan by key, and of their payload how much is on the graphics card.
        private readonly Dictionary<ulong, PlanRow> planned = new Dictionary<ulong, PlanRow>();
        private long plannedBytes, uploadedBytes, frameBytes;
        private bool isBaseUploaded, isBaseDrawn, isDisposed;
        private ShownSet drawn = new ShownSet(), target;
        // Of the newest landing.
        private Landing newest;
        private LandOptions newestOptions;
        private double landedAtMs;
        private double? readyMs, deadlineAtMs;
        private PlanFacts plan;
        private string refusal;
        private IReadOnlyList<uint> missing = Array.Empty<uint>();
        private bool isShowAsked, isPresentableTold, wasToldWhole, isDiskListed;
        private long useCount;

        /// <summary>Begin a visit; it connects in the next updates.</summary>
        /// <param name="options">How.</param>
        /// <param name="files">Of the version that was loaded.</param>
        /// <param name="renderer">Draws it; stays the owner's.</param>
        /// <param name="vertexBytes">What a vertex takes on the graphics card.</param>
        internal SceneClient(SceneClientOptions options, SceneFiles files, IGroundRenderer renderer, int vertexBytes)
        {
            this.options = options;
            this.renderer = renderer;
            Files = files;
            AutoShow = options.AutoShow;
            ShowsCoarse = options.ShowsCoarse;
            session = new SessionCore(options.Session, this);
            link = new Link(session, files.Url, options.Token, options.Connect, OnLink);
            decoders = new DecodeQueue(renderer, options.DecodeThreads, vertexBytes);
            if (options.DiskFolder != null && options.DiskBytes > 0)
                disk = new DiskCache(options.DiskFolder, files.Manifest.Id, options.DiskBytes);
        }

        internal event Action<PlanFacts> Planned;

        /// <summary>Every byte of a landing is here and verified.</summary>
        internal event Action<int> Ready;

        /// <summary>The deadline of a landing has passed: its inner part can be shown.</summary>
        internal event Action<int> Degraded;

        /// <summary>With <see cref="AutoShow"/> off: a landing, or its inner part, can be shown.</summary>
        internal event Action<int> Presentable;

        internal event Action<SceneSwap> Shown;

        internal event Action<int, PickHit> Picked;

        internal event Action<LinkState> LinkChanged;

        internal event Action<TerraportException> Failed;

        internal event Action<GroupChange> GroupChanged;

        /// <summary>A join or gather was refused: code and message.</summary>
        internal event Action<string, string> GroupRefused;

        /// <summary>A landing is shown as soon as it can be; else <see cref="Show"/> must be called.</summary>
        internal bool AutoShow { get; set; }

        internal bool ShowsCoarse { get; set; }

        /// <summary>Files of the version that is drawn, or will be.</summary>
        internal SceneFiles Files { get; private set; }

        /// <summary>The service serves another version than these files: load them, and call <see cref="ReplaceFiles"/>.</summary>
        internal bool NeedsFiles => session.Version != null && session.Version != Files.Manifest.Version;

        internal ShownGround Ground { get; } = new ShownGround();

        internal GroupSession Group => session.Group;

        /// <summary>Segments that are shown, nearest first.</summary>
        internal IReadOnlyList<PlanRow> ShownRows => drawn.Rows;

        internal int ResidentCount => residents.Count;

        internal StreamStats Stats => new StreamStats {
            PayloadBytes = session.PayloadBytes,
            RepeatedBytes = session.RepeatedBytes,
            HeldBytes = session.Cache.Bytes,
            HeldSegments = session.Cache.Count,
        };

        internal int Connections => link.Connections;

        internal LandingStatus Status
        {
            get {
                if (newest == null) return new LandingStatus { Missing = missing };
                double done = plan == null ? 0 : plannedBytes == 0 ? 1 : (newest.HereBytes + uploadedBytes) / (2.0 * plannedBytes);
                return new LandingStatus {
                    Landing = newest.Number,
                    Phase = Phase,
                    Position = newest.Position,
                    RadiusM = newest.RadiusM,
                    Fraction = Math.Min(done, 1),
                    Plan = plan,
                    ReadyMs = readyMs,
                    Missing = missing,
                    Refusal = refusal,
                };
            }
        }

        private LandingPhase Phase
        {
            get {
                if (refusal != null) return LandingPhase.Refused;
                if (drawn.Landing == newest.Number && drawn.IsWhole && target == null) return LandingPhase.Shown;
                if (target != null && target.IsPresentable)
                    return target.IsWhole ? LandingPhase.Presentable : LandingPhase.DegradedPresentable;
                return plan == null ? LandingPhase.Planning : LandingPhase.Streaming;
            }
        }

        /// <summary>Land; it supersedes a landing that is not shown yet. A set that was shown whole and is still there is shown at once.</summary>
        /// <exception cref="ArgumentException">A number that the protocol does not allow; nothing has changed.</exception>
        internal int Land(Vec3 position, double radiusM, LandOptions landOptions = null)
        {
            LandOptions asked = landOptions ?? new LandOptions();
            double? ringM = asked.CoarseRadiusM ?? RingOf(radiusM);
            newest = session.Land(position, radiusM, asked.InnerRadiusM, ringM);
            newestOptions = asked;
            landedAtMs = clock.Elapsed.TotalMilliseconds;
            deadlineAtMs = asked.InnerRadiusM == null ? (double?)null : landedAtMs + asked.DeadlineMs;
            readyMs = null;
            plan = null;
            planned.Clear();
            plannedBytes = uploadedBytes = 0;
            refusal = null;
            missing = Array.Empty<uint>();
            isShowAsked = isPresentableTold = false;
            // What was shown there before, in this version (4, rule 10); the answer names the same set.
            ShownSet before = NeedsFiles ? null : remembered.Find(set => set.IsAt(newest) && set.Keys.All(residents.ContainsKey));
            target = before == null ? null : new ShownSet(newest, before.Rows, before.Hidden, true);
            return newest.Number;
        }

        /// <summary>Note where the user points: what a landing there needs is fetched ahead. Cheap; for every frame.</summary>
        internal void Aim(Vec3 position, double radiusM) { session.Aim(position, radiusM, RingOf(radiusM)); }

        internal int Pick(Vec3 origin, Vec3? direction) { return session.Pick(origin, direction); }

        /// <summary>Connect now, perhaps with another token.</summary>
        internal void Reconnect(string newToken) { link.Reconnect(newToken); }

        /// <summary>Connect again at once.</summary>
        internal void Restart() { link.Restart(); }

        /// <summary>Show the newest landing now if it can be shown, else as soon as it can. True where it was shown now.</summary>
        internal bool Show()
        {
            isShowAsked = true;
            return TrySwap();
        }

        /// <summary>Draw another version from now on; what is shown stays until its base can be drawn.</summary>
        internal void ReplaceFiles(SceneFiles files)
        {
            Files = files;
            isBaseUploaded = false;
            remembered.Clear();
        }

        /// <summary>Once per frame: receive, decode, upload and show what the frame has time for.</summary>
        internal void Update(double budgetMs)
        {
            double startMs = clock.Elapsed.TotalMilliseconds;
            TakeFromDisk(startMs);
            if (deadlineAtMs <= startMs && newest != null)
            {
                deadlineAtMs = null;
                session.Hurry(newest.Number);
            }
            frameBytes = 0;
            while (Step() && clock.Elapsed.TotalMilliseconds - startMs < budgetMs && frameBytes < MaxFrameBytes)
            {
            }
            if (AutoShow || isShowAsked) TrySwap();
            RaiseAll();
        }

        /// <summary>Close the connection and let go of everything that was uploaded.</summary>
        public void Dispose()
        {
            if (isDisposed) return;
            isDisposed = true;
            link.Close();
            disk?.Dispose();
            decoders.Dispose();
        }

        private double? RingOf(double radiusM) { return ShowsCoarse && Files.Manifest.Levels > 1 ? CoarseReach * radiusM : (double?)null; }

        private void TakeFromDisk(double nowMs)
        {
            bool isListed = disk == null || isDiskListed;
            if (!isListed)
            {
                Dictionary<ulong, Box> index = disk.TakeIndex();
                isDiskListed = index != null;
                foreach (KeyValuePair<ulong, Box> file in index ?? new Dictionary<ulong, Box>()) session.Disk[file.Key] = file.Value;
            }
            while (disk != null && disk.TryTake(out KeyValuePair<ulong, byte[]> read))
            {
                if (read.Value != null)
                {
                    decoders.Enqueue(read.Key, read.Value, true);
                    continue;
                }
                pending.Remove(read.Key);
                session.LostOnDisk(read.Key);
            }
            if (isListed || isDiskListed || nowMs > DiskPatienceMs) link.Pump(nowMs);
        }

        /// <summary>Do one slice of work; false where there is none.</summary>
        private bool Step()
        {
            while (uploads.Count < MaxUploads && decoders.TryTake(out DecodeJob result)) OnDecoded(result);
            if (!isBaseUploaded && !NeedsFiles)
            {
                isBaseUploaded = renderer.UploadBase(Files);
                if (isBaseUploaded) ShowBase();
                return true;
            }
            if (decoders.Step()) return true;
            if (uploads.Count > 0)
            {
                Upload(uploads.Dequeue());
                return true;
            }
            return target != null && !target.IsPresentable && isBaseDrawn && !NeedsFiles && PrepareTarget();
        }

        private void OnDecoded(DecodeJob result)
        {
            bool isNew = !session.Cache.Contains(result.Key);
            if (result.Error != null) pending.Remove(result.Key);
            if (result.Error is PayloadException)
            {
                if (result.IsRestored)
                {
                    // Of two reads of a damaged file, the first has removed it.
                    if (session.Disk.TryGetValue(result.Key, out Box box)) disk.Remove(result.Key, box);
                    session.LostOnDisk(result.Key);
                }
                else
                {
                    session.Reject(result.Key);
                }
                return;
            }
            // In the queue before the session hears of it: the landing may be whole with it.
            if (result.Error == null)
                uploads.Enqueue(result);
            else
                CannotDraw(result.Key, result.Error);
            if (isNew)
            {
                session.Accept(result.Key, result.Box, result.Payload);
                if (!result.IsRestored) disk?.Put(result.Key, result.Box, result.Payload);
            }
        }

        private void Upload(DecodeJob result)
        {
            pending.Remove(result.Key);
            bool isWanted = IsNeeded(result.Key) || SpareBytes() + result.GpuBytes <= options.SpareGpuBytes;
            if (isWanted && !residents.ContainsKey(result.Key))
            {
                try
                {
                    renderer.Upload(result.Key, result.Prepared);
                    frameBytes += result.GpuBytes;
                    residents[result.Key] = new Resident { Bytes = result.GpuBytes, Ground = result.Ground };
                    if (planned.TryGetValue(result.Key, out PlanRow row)) uploadedBytes += row.PayloadBytes;
                }
                catch (TerraportException error)
                {
                    CannotDraw(result.Key, error);
                }
            }
            renderer.Discard(result.Prepared);
        }

        /// <summary>A segment that cannot be drawn here: the landing is asked for without it, so that its base stays.</summary>
        private void CannotDraw(ulong key, TerraportException error)
        {
            Raise(() => Failed?.Invoke(error));
            if (!planned.ContainsKey(key)) return;
            target = null;
            if (!session.Exclude(newest, key, planned[key].Id)) refusal = error.Message;
        }

        /// <summary>One slice of what a set needs to be shown; false where nothing can be done in this frame.</summary>
        private bool PrepareTarget()
        {
            foreach (PlanRow row in target.Rows)
            {
                if (!residents.ContainsKey(row.Key)) return false;
                try
                {
                    if (!renderer.IsDrawable(row.Key)) return false;
                }
                catch (TerraportException error)
                {
                    Free(row.Key);
                    CannotDraw(row.Key, error);
                    return false;
                }
            }
            target.IsPresentable = renderer.PrepareHidden(target.Hidden);
            if (target.IsPresentable && !AutoShow && !(isPresentableTold && target.IsWhole == wasToldWhole))
            {
                isPresentableTold = true;
                wasToldWhole = target.IsWhole;
                int landing = target.Landing;
                Raise(() => Presentable?.Invoke(landing));
            }
            return true;
        }

        private bool TrySwap()
        {
            // All of the base's slices at once for a set that was asked for: a return is shown in the next frame.
            while (target != null && !target.IsPresentable && isBaseDrawn && !NeedsFiles && PrepareTarget())
            {
            }
            return target != null && target.IsPresentable && ShowTarget();
        }

        private bool ShowTarget()
        {
            ShownSet next = target;
            target = null;
            // The answer to a landing that was shown before it came names the same set: nothing changes.
            bool isSame = next.IsWhole && drawn.IsWhole && next.Landing == drawn.Landing && next.Keys.SetEquals(drawn.Keys);
            drawn = next;
            if (next.IsWhole)
            {
                remembered.RemoveAll(set => set.IsAt(next));
                remembered.Add(next);
                if (remembered.Count > MaxRemembered) remembered.RemoveAt(0);
            }
            if (!isSame) Swap(false);
            Trim();
            return !isSame;
        }

        /// <summary>The base alone, of the first version or of a new one; the newest landing is asked for again.</summary>
        private void ShowBase()
        {
            bool isFirst = !isBaseDrawn;
            isBaseDrawn = true;
            drawn = new ShownSet();
            target = isFirst ? target : null;
            Swap(true);
            if (!isFirst && newest != null) Land(newest.Position, newest.RadiusM, newestOptions);
        }

        private void Swap(bool isNewBase)
        {
            renderer.Swap(isNewBase, drawn.Keys);
            var meshes = drawn.Rows.Select(row => new KeyValuePair<uint, GroundMesh>(SegmentOf(row.Id), residents[row.Key].Ground));
            Ground.Show(Files.BaseGround, drawn.Hidden, meshes);
            var swap = new SceneSwap {
                Landing = drawn.Landing,
                IsDegraded = !drawn.IsWhole,
                IsNewBase = isNewBase,
                Segments = drawn.Rows.Select(row => row.Id).OrderBy(id => id).ToArray(),
                HiddenBaseFaces = CountBits(drawn.Hidden),
            };
            // At once, in the frame in which it is drawn: users are moved by it.
            Shown?.Invoke(swap);
        }

        /// <summary>The segment of a payload: ids from the segment count on are of the coarser level.</summary>
        private uint SegmentOf(uint id) { return id % (uint)Math.Max(1, Files.Manifest.SegmentCount); }

        private bool IsNeeded(ulong key)
        {
            return planned.ContainsKey(key) || drawn.Keys.Contains(key) || (target != null && target.Keys.Contains(key));
        }

        private long SpareBytes()
        {
            long bytes = 0;
            foreach (KeyValuePair<ulong, Resident> resident in residents) bytes += IsNeeded(resident.Key) ? 0 : resident.Value.Bytes;
            return bytes;
        }

        /// <summary>Free what was shown longest ago, down to the bound of what is not needed.</summary>
        private void Trim()
        {
            useCount++;
            foreach (ulong key in drawn.Keys) residents[key].UsedAt = useCount;
            long spareBytes = SpareBytes();
            if (spareBytes <= options.SpareGpuBytes) return;
            List<ulong> oldest = residents.Keys.Where(key => !IsNeeded(key)).OrderBy(key => residents[key].UsedAt).ToList();
            foreach (ulong key in oldest)
            {
                if (spareBytes <= options.SpareGpuBytes) return;
                spareBytes -= residents[key].Bytes;
                Free(key);
            }
        }

        private void Free(ulong key)
        {
            residents.Remove(key);
            renderer.Free(key);
        }

        private void Raise(Action action) { raised.Enqueue(action); }

        private void RaiseAll()
        {
            while (raised.Count > 0 && !isDisposed) raised.Dequeue()();
        }

        private static int CountBits(byte[] bytes)
        {
            int count = 0;
            foreach (byte one in bytes)
            {
                for (int bits = one; bits != 0; bits &= bits - 1) count++;
            }
            return count;
        }

        /// <summary>A segment on the graphics card.</summary>
        private sealed class Resident
        {
            internal long Bytes, UsedAt;
            internal GroundMesh Ground;
        }

        /// <summary>What is shown together, or shall be.</summary>
        private sealed class ShownSet
        {
            internal readonly int Landing;
            internal readonly List<PlanRow> Rows;
            internal readonly HashSet<ulong> Keys;

            /// <summary>Hidden base faces, one bit each.</summary>
            internal readonly byte[] Hidden;

            /// <summary>All of the landing, and not its inner part alone.</summary>
            internal readonly bool IsWhole;

            /// <summary>A swap can show it.</summary>
            internal bool IsPresentable;
            private readonly Vec3 position;
            private readonly double radiusM;
            private readonly double? coarseRadiusM;

            /// <summary>Nothing but the base.</summary>
            internal ShownSet()
            {
                Rows = new List<PlanRow>();
                Keys = new HashSet<ulong>();
                Hidden = Array.Empty<byte>();
                IsWhole = true;
            }

            internal ShownSet(Landing landing, List<PlanRow> rows, byte[] hidden, bool isWhole)
            {
                Landing = landing.Number;
                position = landing.Position;
                radiusM = landing.RadiusM;
                coarseRadiusM = landing.CoarseRadiusM;
                Rows = rows;
                Keys = new HashSet<ulong>(rows.Select(row => row.Key));
                Hidden = hidden;
                IsWhole = isWhole;
            }

            internal bool IsAt(Landing landing) { return IsAt(landing.Position, landing.RadiusM, landing.CoarseRadiusM); }

            internal bool IsAt(ShownSet other) { return IsAt(other.position, other.radiusM, other.coarseRadiusM); }

            private bool IsAt(Vec3 place, double metres, double? coarseMetres)
            {
                bool isPlace = place.X == position.X && place.Y == position.Y && place.Z == position.Z;
                return isPlace && metres == radiusM && coarseMetres == coarseRadiusM;
            }
        }
    }
}
