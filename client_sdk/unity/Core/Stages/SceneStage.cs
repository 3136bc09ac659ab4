using System;
using System.Collections.Generic;
using Terraport.Wire;

namespace Terraport
{
    /// <summary>
    /// The drawn scene: base mesh, segments of the newest landing, and the swap between two landings. What is visible changes in
    /// one frame, by flags alone: meshes and the base's next lists of faces were made ready before, within each frame's budget.
    /// </summary>
    /// <remarks>
    /// All calls come from the thread that draws. The owner drains the stream's events into <see cref="Handle"/> and calls
    /// <see cref="Update"/> once per frame. Stream and decode queue stay the owner's; dispose of the stage before them.
    /// </remarks>
    public sealed partial class SceneStage : IDisposable
    {
        // Times the radius: as far as the coarser level is worth its bytes (docs/benchmarks.md).
        private const double CoarseReach = 3;

        private readonly ISceneStream stream;
        private readonly ISceneRenderer renderer;
        private readonly StageOptions options;
        private readonly Residency residency;
        private readonly StageUploads uploads;
        private SceneFiles files;
        private BaseFaces baseFaces;
        /// <summary>Lists of a version whose base is not drawn yet; null where none is on its way.</summary>
        private BaseFaces nextBase;
        /// <summary>The base of <see cref="files"/> can be drawn; false until it was uploaded.</summary>
        private bool isBaseUploaded;
        // Landing for which Show was called; it is shown as soon as it is presentable.
        private int landingToShow;
        // How long Update took, the last time and at most; for figures.
        private double updateMs;
        private double updateMaxMs;
        private bool isDisposed;

        /// <summary>A stage that shows nothing yet: base and segments come in <see cref="Update"/>.</summary>
        /// <exception cref="ArgumentException">An option that bounds nothing.</exception>
        public SceneStage(
            ISceneStream stream, SceneFiles files, ISceneRenderer renderer, IDecodeQueue decoders, StageOptions options = null)
        {
            if (stream == null || files == null || renderer == null || decoders == null)
            {
                throw new ArgumentNullException("stream", "stream, files, renderer and decoders must be there");
            }
            this.stream = stream;
            this.files = files;
            this.renderer = renderer;
            this.options = options ?? new StageOptions();
            this.options.Check();
            AutoShow = this.options.AutoShow;
            ShowsCoarse = this.options.ShowsCoarse;
            residency = new Residency(this.options);
            uploads = new StageUploads(residency, stream, renderer, decoders, RaiseDecodeFailed) { Attributes = files.Manifest.Attributes };
            baseFaces = new BaseFaces(files, renderer, this.options.BaseBlockFaces);
        }

        /// <summary>What was drawn changed: after every swap, that of a new base included.</summary>
        public event Action<SceneSwap> Swapped;

        /// <summary>A segment cannot be decoded or drawn: its base stays.</summary>
        public event Action<uint, TerraportException> DecodeFailed;

        /// <summary>A landing is shown as soon as it is presentable; else <see cref="Show"/> must be called.</summary>
        public bool AutoShow { get; set; }

        /// <summary>Landings and aims from now on ask for a ring of the coarser level: <see cref="StageOptions.ShowsCoarse"/>.</summary>
        public bool ShowsCoarse { get; set; }

        /// <summary>Base, cover and regions that the stage shows, or will show.</summary>
        public SceneFiles Files => files;

        /// <summary>
        /// Another scene version was opened: load its files and call <see cref="ReplaceFiles"/>. Until then what is shown
        /// stays.
        /// </summary>
        public bool NeedsFiles { get; private set; }

        /// <summary>
        /// Version that the session has open: what <see cref="SceneLoader"/> is to be asked for; null before it is open.
        /// </summary>
        public string NeededVersion { get; private set; }

        /// <summary>Whether the base is drawn.</summary>
        public bool IsBaseDrawn { get; private set; }

        /// <summary>Ids of payloads shown, ascending: from the manifest's SegmentCount on those of the coarser level.</summary>
        public IReadOnlyList<uint> Visible => residency.Visible;

        /// <summary>Base faces that are hidden.</summary>
        public int HiddenBaseFaces => baseFaces.DrawnHiddenCount;

        /// <summary>Ask for a landing; it supersedes any that is not shown yet. Its number.</summary>
        /// <exception cref="ArgumentException">A number that the protocol does not allow; nothing has changed.</exception>
        public int Land(Vec3 position, double radiusM, LandOptions landOptions = null)
        {
            LandOptions asked = landOptions;
            double? ringM = RingOf(radiusM);
            if (ringM.HasValue && (asked == null || !asked.CoarseRadiusM.HasValue))
            {
                // A copy: the caller's options name no ring of another scene's landing afterwards.
                asked = asked == null ? new LandOptions() : asked.Copy();
                asked.CoarseRadiusM = ringM;
            }
            int landing = stream.Land(position, radiusM, asked);
            residency.Land(landing, position, radiusM, options.ClockMs());
            return landing;
        }

        /// <summary>
        /// Tell where the user points: what lies there is fetched ahead and, as far as there is room, made drawable.
        /// </summary>
        public void Aim(Vec3 position, double radiusM) { stream.Aim(position, radiusM, RingOf(radiusM)); }

        /// <summary>Take an event of the stream; every one, in their order.</summary>
        public void Handle(ref StreamEvent next)
        {
            switch (next.Kind)
            {
                case StreamEventKind.Opened:
                    NeededVersion = next.SceneVersion;
                    // Changed since the last connection, or, on the first, other than the files that were loaded.
                    if (next.IsChanged || (next.SceneVersion != files.Manifest.Version && !NeedsFiles))
                    {
                        LeaveVersion();
                    }
                    break;
                case StreamEventKind.Planned: residency.Planned(next.Plan); break;
                case StreamEventKind.Arrived: residency.Arrived(next.Facts, next.Landing); break;
                case StreamEventKind.Degraded: residency.Degraded(next.Landing ?? 0, next.Segments); break;
                case StreamEventKind.Ready:
                    residency.Ready(next.Landing ?? 0, next.Segments, next.Missing, next.ElapsedMs, next.Bytes);
                    break;
                case StreamEventKind.Refused:
                    // An error of the session or of an aim changes nothing that is drawn.
                    if (next.Landing != null)
                    {
                        residency.Refused(next.Landing.Value, next.Message);
                    }
                    break;
                case StreamEventKind.Dropped: residency.Dropped(next.Segments); break;
            }
        }

        /// <summary>
        /// Once per frame, before it is drawn: ask for decodes, make meshes and lists ready while the budget lasts (one step at
        /// least), free, and swap where that is due.
        /// </summary>
        /// <param name="budgetMs">Milliseconds of this frame.</param>
        public void Update(double budgetMs)
        {
            if (isDisposed)
            {
                return;
            }
            // 1. What became drawable since the last frame, and what is to be freed.
            double startMs = options.ClockMs();
            uploads.BeginFrame();
            // 2. The base's lists follow what the next swap will show.
            if (IsBaseDrawn && !NeedsFiles && residency.Coming != null)
            {
                baseFaces.Prepare(residency.Coming, residency.ComingRevision);
            }
            // 3. Slices of work until the frame's time or bytes are used up; one at least, so that a budget of 0 still gets there.
            long bytes = 0;
            do
            {
                long slice = Step();
                if (slice == 0)
                {
                    break;
                }
                bytes += slice;
            }
            while (bytes < options.MaxFrameUploadBytes && options.ClockMs() - startMs < budgetMs);
            // 4. Uploads made room: decode more, beside the drawing. Then swap, if everything is there.
            uploads.AskForDecodes();
            residency.BasePrepared(baseFaces.PreparedRevision);
            double nowMs = options.ClockMs();
            residency.Settle(nowMs);
            if (residency.Newest != null && (AutoShow || landingToShow == residency.Newest.Landing))
            {
                TrySwap();
            }
            updateMs = options.ClockMs() - startMs;
            updateMaxMs = Math.Max(updateMaxMs, updateMs);
        }

        /// <summary>
        /// Show the newest landing: now where it is presentable, else in the first Update where it is; the rest of a degraded one too.
        /// Whether it was shown now.
        /// </summary>
        public bool Show()
        {
            if (isDisposed || residency.Newest == null)
            {
                return false;
            }
            landingToShow = residency.Newest.Landing;
            return TrySwap();
        }

        /// <summary>
        /// Base, cover and regions of <see cref="NeededVersion"/>; what is shown of the old version goes when the new base is drawable.
        /// Files of another version are not taken: their ids would be taken for those of the session.
        /// </summary>
        public void ReplaceFiles(SceneFiles newFiles)
        {
            if (newFiles == null)
            {
                throw new ArgumentNullException("newFiles");
            }
            // Published once more while they were loaded: the owner will ask for the newer ones.
            if (NeededVersion != null && newFiles.Manifest.Version != NeededVersion)
            {
                return;
            }
            if (!NeedsFiles)
            {
                LeaveVersion();
            }
            files = newFiles;
            nextBase = new BaseFaces(files, renderer, options.BaseBlockFaces);
            uploads.Attributes = files.Manifest.Attributes;
            NeedsFiles = false;
        }

        /// <summary>
        /// Hide and free every segment, at once; the base stays the renderer's. Stream and decode queue are not closed.
        /// </summary>
        public void Dispose()
        {
            if (isDisposed)
            {
                return;
            }
            isDisposed = true;
            uploads.FreeAllButShown();
            // Freed in two parts: what is drawn must be hidden by the swap in between.
            uint[] visible = residency.Visible;
            residency.ClearVisible();
            renderer.Swap(new SceneSwap { Hidden = visible, BaseHidden = baseFaces.Hidden });
            uploads.FreeShown(visible);
        }

        /// <summary>How far a landing shows the coarser level; null where the scene has none, or nobody wants it.</summary>
        private double? RingOf(double radiusM)
        {
            return ShowsCoarse && files.Manifest.Levels > 1 ? Math.Min(radiusM * CoarseReach, WireLimits.MaxRadiusM) : (double?)null;
        }

        private bool CanSwap => IsBaseDrawn && !NeedsFiles;

        /// <summary>Ids mean other segments now: all but what is shown is freed.</summary>
        private void LeaveVersion()
        {
            uploads.FreeAllButShown();
            residency.VersionChanged();
            NeedsFiles = NeededVersion != files.Manifest.Version;
            // The files may be those of the new version already: loaded before the session was opened.
            nextBase = NeedsFiles ? null : new BaseFaces(files, renderer, options.BaseBlockFaces);
            uploads.Attributes = NeedsFiles ? null : files.Manifest.Attributes;
            isBaseUploaded = false;
            IsBaseDrawn = false;
        }

        /// <summary>One slice of work, most urgent first: its bytes, or 0 where there is nothing to do now.</summary>
        private long Step()
        {
            // Freeing first: it gives memory that the uploads behind it take. Then the base, without which nothing is shown.
            long bytes = uploads.FreeNext();
            if (bytes > 0)
            {
                return bytes;
            }
            if (!NeedsFiles && !isBaseUploaded)
            {
                isBaseUploaded = renderer.UploadBase(files);
                if (isBaseUploaded)
                {
                    ShowBase();
                }
                return 1;
            }
            bytes = uploads.TakeDecoded();
            if (bytes == 0 && IsBaseDrawn)
            {
                bytes = baseFaces.Step();
                bytes = bytes > 0 ? bytes : uploads.UploadNext();
            }
            return bytes > 0 ? bytes : uploads.DecodeNext();
        }

        /// <summary>A new base takes the place of the one before, and of every segment that was shown over it.</summary>
        private void ShowBase()
        {
            if (nextBase != null)
            {
                baseFaces = nextBase;
                nextBase = null;
            }
            uint[] previous = residency.Visible;
            residency.ClearVisible();
            IsBaseDrawn = true;
            ApplySwap(new SceneSwap { IsNewBase = true, Hidden = previous });
            uploads.FreeShown(previous);
        }

        private bool TrySwap()
        {
            SceneSwap swap = CanSwap ? residency.Swap() : null;
            if (swap == null)
            {
                return false;
            }
            // In the same swap: faces are hidden exactly when the segments over them are drawn.
            swap.ChangedBlocks = baseFaces.Flip();
            ApplySwap(swap);
            return true;
        }

        private void RaiseDecodeFailed(uint segment, TerraportException error)
        {
            if (DecodeFailed != null)
            {
                DecodeFailed(segment, error);
            }
        }

        private void ApplySwap(SceneSwap swap)
        {
            // The renderer first, listeners second: they may look at what is drawn.
            swap.BaseHidden = baseFaces.Hidden;
            renderer.Swap(swap);
            if (Swapped != null)
            {
                Swapped(swap);
            }
        }
    }
}
