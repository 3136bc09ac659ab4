using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.Reflection;
using System.Threading;
using Terraport.Unity;
using UnityEngine;

namespace Terraport.Stubs
{
    /// <summary>
    /// Runs TerraportScene on the stubs, against a live service: lands twice, looks at what would be drawn in the frame of each swap, and
    /// at what is left after closing. A line of figures for each landing; exit code 1 where something is wrong.
    ///
    ///     mono SceneOnStubs.exe SCENE_URL RADIUS_M [TOKEN] [changing]
    ///
    /// With "changing" it then writes "change" and waits for a line; whoever started it has published another version by then. It connects
    /// anew, and the new version must take the place of the old in one frame.
    /// </summary>
    public static partial class SceneOnStubs
    {
        private const int FrameMs = 5;
        private const int PatienceMs = 60000;

        private static readonly List<string> Faults = new List<string>();
        private static TerraportScene scene;
        private static Action update;
        private static PlanFacts plan;
        private static SceneSwap lastSwap;
        private static Vec3 middle;
        private static int swaps;
        private static double updateMaxMs;
        private static double lookMs;
        private static double allLookMs;

        /// <summary>See the class.</summary>
        public static int Main(string[] arguments)
        {
            float radiusM = float.Parse(arguments[1], System.Globalization.CultureInfo.InvariantCulture);
            GameObject holder = new GameObject("scene");
            holder.SetActive(false);
            scene = holder.AddComponent<TerraportScene>();
            scene.SceneUrl = arguments[0];
            scene.Token = arguments.Length > 2 && arguments[2].Length > 0 ? arguments[2] : null;
            scene.Planned += facts => plan = facts;
            scene.Failed += why => Faults.Add(why.Code + ": " + why.Message);
            scene.Shown += OnShown;
            MethodInfo message = typeof(TerraportScene).GetMethod("Update", BindingFlags.Instance | BindingFlags.NonPublic);
            update = (Action)Delegate.CreateDelegate(typeof(Action), scene, message);
            int before = LiveCount();
            scene.Open();
            RunUntil(() => scene.Files != null && lastSwap != null, "the base");
            if (Faults.Count == 0)
            {
                Vec3 low = scene.Files.Manifest.BoundsMin, high = scene.Files.Manifest.BoundsMax;
                middle = new Vec3((low.X + high.X) / 2, (low.Y + high.Y) / 2, (low.Z + high.Z) / 2);
                Land(middle, radiusM);
                Land(new Vec3(middle.X + radiusM / 2, middle.Y, middle.Z + radiusM / 3), radiusM);
                Land(middle, radiusM);
                if (Faults.Count == 0)
                {
                    ShowByHand(new Vec3(middle.X, middle.Y, middle.Z - radiusM / 2), radiusM);
                    Teleport(new Vec3(middle.X - radiusM / 2, middle.Y, middle.Z), radiusM);
                    GoTogether(middle, radiusM);
                    SwitchRing(middle, radiusM);
                }
                Rest();
                if (Faults.Count == 0 && arguments.Length > 3 && arguments[3] == "changing")
                {
                    Change(radiusM);
                }
            }
            scene.Close();
            Expect(before, LiveCount(), "objects left after closing");
            if (Faults.Count == 0)
            {
                CloseWithin();
                Expect(before, LiveCount(), "objects left after closing within an event");
            }
            if (Faults.Count == 0)
            {
                Preview();
                Expect(before, LiveCount(), "objects left after a preview");
            }
            Faults.ForEach(fault => Console.WriteLine("wrong: " + fault));
            return Faults.Count == 0 ? 0 : 1;
        }

        private static void Land(Vec3 place, float radiusM)
        {
            plan = null;
            swaps = 0;
            updateMaxMs = 0;
            allLookMs = 0;
            Stopwatch watch = Stopwatch.StartNew();
            scene.Land(scene.ToWorld(place), radiusM);
            RunUntil(() => scene.Status.Phase == LandingPhase.Shown, "a landing");
            if (Faults.Count > 0)
            {
                return;
            }
            Console.WriteLine(
                "landing {0}: {1} segments, {2} triangles drawn, {3} base faces hidden, {4} loaded, ready {5:0} ms, shown {6:0} ms, "
                    + "longest frame {7:0.0} ms",
                lastSwap.Landing, scene.Figures.Segments, scene.Figures.DrawnTriangles, lastSwap.BaseHidden.Count, plan.Load.Count,
                scene.Status.ReadyMs, watch.Elapsed.TotalMilliseconds - allLookMs, updateMaxMs);
            Expect(1, swaps, "swaps of a landing");
        }

        /// <summary>Without AutoShow nothing is shown before it is asked for; that it can be is told once.</summary>
        private static void ShowByHand(Vec3 place, float radiusM)
        {
            int presentable = 0;
            Action<int> count = number => presentable++;
            scene.Presentable += count;
            scene.AutoShow = false;
            swaps = 0;
            scene.Land(scene.ToWorld(place), radiusM);
            RunUntil(() => presentable > 0, "a landing that can be shown");
            for (int frame = 0; frame < 20; frame++)
            {
                update();
            }
            Expect(1, presentable, "times that a landing was told as presentable");
            Expect(0, swaps, "swaps that nobody asked for");
            Expect(1, scene.Show() ? 1 : 0, "landings shown when asked for");
            Expect(1, swaps, "swaps that were asked for");
            scene.AutoShow = true;
            scene.Presentable -= count;
        }

        /// <summary>By the user's component and the fade's: the swap and the move in one dark frame, and nothing of it is left.</summary>
        private static void Teleport(Vec3 place, float radiusM)
        {
            GameObject holder = new GameObject("user"), rig = new GameObject("rig");
            TerraportUser user = holder.AddComponent<TerraportUser>();
            user.Scene = scene;
            user.Rig = rig.transform;
            user.RadiusM = radiusM;
            TerraportTeleport teleport = holder.AddComponent<TerraportTeleport>();
            Send(teleport, "Awake");
            Send(user, "OnEnable"); // Lands at the rig's place, as set by default.
            RunUntil(() => !user.IsComing, "the landing at the start");
            int shown = 0;
            bool isDark = false;
            user.Arrived += point => shown += isDark && swaps > 0 ? 1 : 100;
            swaps = 0;
            plan = null;
            Expect(1, teleport.TeleportTo(scene.ToWorld(place)) ? 1 : 0, "teleports begun");
            Expect(0, scene.AutoShow ? 1 : 0, "scenes that show by themselves in a teleport");
            RunUntil(
                () =>
                {
                    Send(teleport, "Update");
                    isDark = CurtainIsClosed();
                    if (!isDark)
                    {
                        Expect(0, teleport.IsTeleporting && user.IsComing ? swaps : 0, "swaps in the light");
                    }
                    return !teleport.IsTeleporting;
                },
                "the end of a teleport");
            Expect(1, shown, "arrivals in the dark");
            Expect(1, swaps, "swaps of a teleport");
            Expect(1, scene.AutoShow ? 1 : 0, "scenes that show by themselves again");
            GroundHit ground;
            Vector3 feet = rig.transform.position;
            bool isGround = scene.GroundAt(new Vector3(feet.x, feet.y + 1, feet.z), out ground);
            Expect(0, isGround ? (long)Math.Round(1000 * Math.Abs(ground.Point.y - feet.y)) : 1000, "millimetres between feet and ground");
            Vector3 met;
            Ray down = new Ray(new Vector3(feet.x, feet.y + 50, feet.z), new Vector3(0, -1, 0));
            Expect(1, user.TryAim(down, out met) && Math.Abs(met.y - feet.y) < 0.001 ? 1 : 0, "aims that met the ground");
            Physics.StubWallLayers = 6;
            Physics.StubWallAtM = 10;
            Expect(1, user.TryAim(down, out met) ? 1 : 0, "aims that nothing was asked to stop");
            user.Obstacles = MaskOf(1);
            Expect(1, user.TryAim(down, out met) ? 1 : 0, "aims past what is on another layer");
            user.Obstacles = MaskOf(4);
            Expect(0, user.TryAim(down, out met) ? 1 : 0, "aims through an obstacle");
            Physics.StubWallAtM = 60;
            Expect(1, user.TryAim(down, out met) ? 1 : 0, "aims at ground before an obstacle");
            Physics.StubWallLayers = 0;
            Expect(0, user.LandAtPlace("no such place") || teleport.TeleportToPlace("no such place") ? 1 : 0, "places that nobody named");
            WalkOnDetail(rig.transform);
            Send(teleport, "OnDisable");
            Send(user, "OnDisable");
            UnityEngine.Object.DestroyImmediate(holder);
            UnityEngine.Object.DestroyImmediate(rig);
        }

        /// <summary>By the group's component: a seat, a landing of the group that is followed, and its barrier opens.</summary>
        private static void GoTogether(Vec3 place, float radiusM)
        {
            TerraportGroup group = scene.gameObject.AddComponent<TerraportGroup>();
            int called = 0, refused = 0;
            GroupGathering gathered = null;
            group.Called += (point, metres) => called += Math.Abs(scene.ToWorld(place).x - point.x) < 0.001f ? 1 : 100;
            group.Gathered += gathering => gathered = gathering;
            group.Refused += (code, why) => refused++;
            Expect(0, group.Join("tour", GroupRole.Guide, "Ada") ? 1 : 0, "seats before the component is switched on");
            Send(group, "OnEnable");
            Expect(1, group.Join("tour", GroupRole.Guide, "Ada") ? 1 : 0, "seats asked for");
            RunUntil(() => group.Members.Count == 1, "a list of who is there");
            Expect(1, group.Members[0].Name == "Ada" && group.Members[0].Role == GroupRole.Guide ? 1 : 0, "guides by the name of Ada");
            swaps = 0;
            Expect(1, group.Gather(scene.ToWorld(place), radiusM) ? 1 : 0, "gathers");
            RunUntil(
                () =>
                {
                    Send(group, "LateUpdate");
                    return gathered != null;
                },
                "everybody to be there");
            Expect(1, called, "landings of the group that were told");
            Expect(1, swaps, "swaps of a landing with the group");
            Expect(1, gathered != null && gathered.Ready.Count == 1 && gathered.Ready[0] == group.Group.Member ? 1 : 0, "members there");
            // Who does not follow stays, and holds nobody up.
            group.Follows = false;
            gathered = null;
            swaps = 0;
            Expect(1, group.GatherHere() ? 1 : 0, "gathers here");
            RunUntil(() => gathered != null, "nobody to be waited for");
            Expect(1, gathered != null && gathered.Missing.Count == 1 ? 1 : 0, "members that stay");
            Expect(0, swaps, "swaps of who does not follow");
            Expect(0, refused, "refusals");
            group.Leave();
            Expect(0, group.Members.Count, "members of a group that was left");
            Send(group, "OnDisable");
            UnityEngine.Object.DestroyImmediate(group);
        }

        /// <summary>Bodies stand where feet do: the ground is solid around them, wherever they have walked.</summary>
        private static void WalkOnDetail(Transform feet)
        {
            TerraportFeetCollider collider = scene.gameObject.AddComponent<TerraportFeetCollider>();
            collider.Feet = feet;
            Send(collider, "OnEnable");
            for (int step = 0; step < 10; step++)
            {
                Vector3 at = feet.position;
                feet.position = new Vector3(at.x + 1.3f, at.y, at.z + 0.4f);
                RunUntil(
                    () =>
                    {
                        Send(collider, "Update");
                        return collider.IsCurrent;
                    },
                    "solid ground");
                GroundHit ground;
                at = feet.position;
                if (!scene.GroundAt(new Vector3(at.x, at.y + 1, at.z), out ground))
                {
                    continue; // Beyond the scene.
                }
                feet.position = ground.Point;
                float solid = SolidHeight(scene.gameObject.GetComponents<MeshCollider>()[0].sharedMesh, ground.Point);
                Expect(0, (long)Math.Round(1000 * Math.Abs(solid - ground.Point.y)), "millimetres between solid and shown ground");
            }
            Send(collider, "OnDisable");
            UnityEngine.Object.DestroyImmediate(collider);
        }

        private static LayerMask MaskOf(int bits) { return new LayerMask { value = bits }; }

        private static float SolidHeight(Mesh mesh, Vector3 at)
        {
            Vector3[] corners = (Vector3[])mesh.VertexData;
            float highest = float.MinValue;
            for (int face = 0; face < corners.Length; face += 3)
            {
                Vector3 a = corners[face], b = corners[face + 1], c = corners[face + 2];
                double ux = b.x - a.x, uz = b.z - a.z, vx = c.x - a.x, vz = c.z - a.z, x = at.x - a.x, z = at.z - a.z;
                double area = ux * vz - uz * vx, beta = (x * vz - z * vx) / area, gamma = (ux * z - uz * x) / area;
                if (beta >= -1e-6 && gamma >= -1e-6 && beta + gamma <= 1 + 1e-6)
                {
                    highest = Math.Max(highest, (float)(a.y + beta * (b.y - a.y) + gamma * (c.y - a.y)));
                }
            }
            return highest;
        }

        private static void Send(object component, string message)
        {
            component.GetType().GetMethod(message, BindingFlags.Instance | BindingFlags.NonPublic).Invoke(component, null);
        }

        private static bool CurtainIsClosed()
        {
            foreach (MeshRenderer renderer in UnityEngine.Object.LiveOf<MeshRenderer>())
            {
                if (renderer.enabled && IsCurtain(renderer))
                {
                    return renderer.sharedMaterial.GetFloat(Shader.PropertyToID("_TerraportFade")) >= 1;
                }
            }
            return false;
        }

        private static bool IsCurtain(MeshRenderer renderer) { return renderer.gameObject.name == "terraport fade"; }

        /// <summary>A listener may close the scene from within any event, in the middle of the stage's own work.</summary>
        private static void CloseWithin()
        {
            lastSwap = null;
            scene.Shown += CloseOnShown;
            scene.Open();
            RunUntil(() => !scene.IsOpen, "the base, once more");
            scene.Shown -= CloseOnShown;
            update();
        }

        private static void CloseOnShown(SceneSwap swap) { scene.Close(); }

        /// <summary>In the editor: the base and a landing below the camera, anew when it has moved, and gone when it is switched off.</summary>
        private static void Preview()
        {
            Application.StubIsPlaying = false;
            scene.gameObject.SetActive(true);
            scene.AutoShow = true;
            Send(scene, "OnEnable");
            Expect(1, TerraportScene.NotPlayed.Count, "scenes for the editor to step");
            Vector3 camera = scene.ToWorld(new Vec3(middle.X, middle.Y + 500, middle.Z));
            Expect(0, scene.StepPreview(camera) || scene.IsOpen ? 1 : 0, "previews that nobody switched on");
            scene.PreviewsInEditor = true;
            lastSwap = null;
            update = () => scene.StepPreview(camera);
            RunUntil(() => lastSwap != null && lastSwap.Landing > 0, "the preview's landing");
            Expect(1, scene.Figures.Segments > 0 ? 1 : 0, "previews that show detail below the camera");
            foreach (MeshRenderer renderer in UnityEngine.Object.LiveOf<MeshRenderer>())
            {
                Expect((long)HideFlags.HideAndDontSave, (long)renderer.gameObject.hideFlags, "flags of a previewed object");
            }
            int landing = scene.Status.Landing;
            camera = new Vector3(camera.x + 1, camera.y, camera.z);
            update();
            Expect(landing, scene.Status.Landing, "landings a metre aside");
            camera = new Vector3(camera.x + 0.3f * scene.DefaultRadiusM, camera.y, camera.z);
            update();
            Expect(landing + 1, scene.Status.Landing, "landings farther away");
            // What the engine sends when anything changes must not step it a second time.
            Send(scene, "Update");
            scene.PreviewsInEditor = false;
            update();
            Expect(0, scene.IsOpen ? 1 : 0, "previews after they were switched off");
            scene.PreviewsInEditor = true;
            lastSwap = null;
            RunUntil(() => lastSwap != null, "the preview once more");
            // As before scripts are compiled anew.
            Send(scene, "OnDisable");
            Expect(0, TerraportScene.NotPlayed.Count, "scenes for the editor to step, after that");
            scene.gameObject.SetActive(false);
            Application.StubIsPlaying = true;
        }

        /// <summary>A frame in which nothing comes must make no garbage at all.</summary>
        private static void Rest()
        {
            const int frames = 200;
            for (int frame = 0; frame < frames; frame++)
            {
                update();
                Thread.Sleep(1);
            }
            long before = GC.GetAllocatedBytesForCurrentThread();
            for (int frame = 0; frame < frames; frame++)
            {
                update();
            }
            long bytes = GC.GetAllocatedBytesForCurrentThread() - before;
            Console.WriteLine("{0} frames at rest: {1} bytes of garbage", frames, bytes);
            Expect(0, bytes, "bytes of garbage at rest");
        }

        private static void Change(float radiusM)
        {
            string before = scene.Files.Manifest.Version;
            Console.WriteLine("change");
            Console.Out.Flush();
            Console.ReadLine();
            int segments = 0;
            scene.Shown += swap => segments = swap.IsNewBase ? swap.Hidden.Count : segments;
            lastSwap = null;
            scene.Reconnect(scene.Token ?? "another");
            RunUntil(() => lastSwap != null && lastSwap.IsNewBase, "the new base");
            if (Faults.Count == 0)
            {
                Console.WriteLine(
                    "version {0} took the place of {1}; {2} segments of it went", scene.Files.Manifest.Version, before, segments);
                Expect(0, string.CompareOrdinal(before, scene.Files.Manifest.Version) == 0 ? 1 : 0, "versions that are the same");
                Vec3 low = scene.Files.Manifest.BoundsMin, high = scene.Files.Manifest.BoundsMax;
                Land(new Vec3((low.X + high.X) / 2, (low.Y + high.Y) / 2, (low.Z + high.Z) / 2), radiusM);
            }
        }

        private static void RunUntil(Func<bool> isDone, string what)
        {
            Stopwatch watch = Stopwatch.StartNew();
            while (!isDone() && Faults.Count == 0)
            {
                Stopwatch frame = Stopwatch.StartNew();
                update();
                updateMaxMs = Math.Max(updateMaxMs, frame.Elapsed.TotalMilliseconds - lookMs);
                allLookMs += lookMs;
                lookMs = 0;
                if (watch.ElapsedMilliseconds > PatienceMs)
                {
                    Faults.Add("no sign of " + what + " within " + PatienceMs + " ms");
                }
                Thread.Sleep(FrameMs);
            }
        }

        /// <summary>What is drawn must be right in this very frame: in it the user sees the new set for the first time.</summary>
        private static void OnShown(SceneSwap swap)
        {
            Stopwatch watch = Stopwatch.StartNew();
            lastSwap = swap;
            swaps++;
            Look(swap);
            lookMs += watch.Elapsed.TotalMilliseconds;
        }

        private static void Look(SceneSwap swap)
        {
            List<Mesh> detail = new List<Mesh>();
            long baseFaces = 0;
            foreach (MeshRenderer renderer in UnityEngine.Object.LiveOf<MeshRenderer>())
            {
                if (!renderer.enabled || IsCurtain(renderer))
                {
                    continue;
                }
                Mesh mesh = renderer.gameObject.GetComponent<MeshFilter>().sharedMesh;
                // The base is drawn after the detail: by another material.
                if (renderer.sharedMaterial.renderQueue > 0)
                {
                    baseFaces += mesh.SubMesh.indexCount / 3;
                }
                else
                {
                    detail.Add(mesh);
                }
            }
            Expect(scene.Files.Base.FaceCount - swap.BaseHidden.Count, baseFaces, "base faces drawn");
            if (swap.Landing > 0)
            {
                CheckDetail(detail);
            }
            else
            {
                Expect(0, detail.Count, "segments drawn beside a new base");
            }
        }

        private static void CheckDetail(List<Mesh> detail)
        {
            Expect(plan.Load.Count + plan.Keep.Count, detail.Count, "segments drawn");
            Dictionary<string, SegmentFacts> facts = new Dictionary<string, SegmentFacts>();
            // What is coarser lies within its segment's box, and need not fill it.
            foreach (SegmentFacts segment in plan.Load)
            {
                if (segment.Segment < scene.Files.Manifest.SegmentCount)
                    facts[KeyOf(MeshFiller.ToBounds(Axes.Turn(segment.Bounds)))] = segment;
            }
            int found = 0;
            foreach (Mesh mesh in detail)
            {
                SegmentFacts segment;
                if (facts.TryGetValue(KeyOf(mesh.bounds), out segment))
                {
                    found++;
                    Expect(segment.Faces, mesh.SubMesh.indexCount / 3, "faces of a segment");
                    Expect(segment.Vertices, mesh.VertexData.Length, "vertices of a segment");
                }
                CheckMesh(mesh);
            }
            Expect(facts.Count, found, "segments whose box is that of the plan, turned");
        }

        private static string KeyOf(Bounds box)
        {
            return string.Format(System.Globalization.CultureInfo.InvariantCulture, "{0:R} {1:R} {2:R} {3:R} {4:R} {5:R}", box.center.x,
                box.center.y, box.center.z, box.size.x, box.size.y, box.size.z);
        }

        private static int LiveCount()
        {
            // Shaders are assets: loaded, not made.
            return UnityEngine.Object.LiveOf<UnityEngine.Object>().Count - UnityEngine.Object.LiveOf<Shader>().Count;
        }

        private static void Expect(long expected, long actual, string what)
        {
            if (expected != actual)
            {
                Faults.Add(what + ": " + actual + ", expected " + expected);
            }
        }
    }
}
