using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.Globalization;
using System.Linq;
using System.Reflection;
using System.Threading;
using Terraport.Unity;
using UnityEngine;

namespace Terraport.Stubs
{
    /// <summary>
    /// Runs TerraportScene and the components around it on the stubs, against a live service, and checks what would be drawn in the frame of
    /// each swap, and what is left after closing. Exit code 1 where something is wrong.
    ///
    ///     mono SceneOnStubs.exe SCENE_URL RADIUS_M [changing]
    ///
    /// With "changing" it writes "change" and waits for a line: by then another version was published, which must take the place of the old.
    /// </summary>
    public static class SceneOnStubs
    {
        private const int FrameMs = 5, PatienceMs = 60000;

        private static readonly List<string> Faults = new List<string>();
        private static TerraportScene scene;
        private static Action update;
        private static PlanFacts plan;
        private static SceneSwap lastSwap;
        private static Vec3 middle;
        private static float radiusM;
        private static int swaps;

        private static int Main(string[] arguments)
        {
            radiusM = float.Parse(arguments[1], CultureInfo.InvariantCulture);
            GameObject holder = new GameObject("scene");
            holder.SetActive(false);
            scene = holder.AddComponent<TerraportScene>();
            scene.SceneUrl = arguments[0];
            scene.Planned += facts => plan = facts;
            scene.Failed += why => Faults.Add(why.Code + ": " + why.Message);
            scene.Shown += OnShown;
            update = () => Send(scene, "Update");
            int before = LiveCount();
            Action[] parts = { LandAndReturn, ShowByHand, Teleport, GoTogether, SwitchRing, Rest };
            scene.Open();
            RunUntil(() => scene.Files != null && lastSwap != null, "the base");
            foreach (Action part in parts.Where(part => Faults.Count == 0)) part();
            if (Faults.Count == 0 && arguments.Length > 2) Change();
            scene.Close();
            Expect(before, LiveCount(), "objects left after closing");
            if (Faults.Count == 0) CloseWithin();
            Expect(before, LiveCount(), "objects left after closing within an event");
            if (Faults.Count == 0) Preview();
            Expect(before, LiveCount(), "objects left after a preview");
            Faults.ForEach(fault => Console.WriteLine("wrong: " + fault));
            return Faults.Count == 0 ? 0 : 1;
        }

        private static void LandAndReturn()
        {
            Vec3 low = scene.Files.Manifest.BoundsMin, high = scene.Files.Manifest.BoundsMax;
            middle = 0.5 * (low + high);
            Land(middle);
            MeetVertices();
            Land(middle + new Vec3(radiusM / 2, 0, radiusM / 3));
            // A return is shown in the next frame, before the service has answered.
            swaps = 0;
            scene.Land(scene.ToWorld(middle), radiusM);
            update();
            Expect(1, swaps, "swaps in the frame of a return");
            RunUntil(
                () => plan != null && plan.LoadSegments == 0 && scene.Status.Phase == LandingPhase.Shown && scene.Status.ReadyMs != null,
                "the answer");
            Expect(1, swaps, "swaps of a return in all");
        }

        /// <summary>Rays meet what is drawn, where it is drawn: the same axes for both.</summary>
        private static void MeetVertices()
        {
            foreach (MeshRenderer renderer in UnityEngine.Object.LiveOf<MeshRenderer>().Where(one => one.enabled))
            {
                Mesh mesh = renderer.gameObject.GetComponent<MeshFilter>().sharedMesh;
                if (renderer.sharedMaterial.renderQueue > 0) continue; // The base: detail may be above it.
                GroundVertex vertex = ((GroundVertex[])mesh.VertexData)[0];
                bool isMet = scene.GroundAt(new Vector3(vertex.X, vertex.Y + 0.5f, vertex.Z), out GroundHit ground);
                Expect(true, isMet && ground.Point.y > vertex.Y - 0.01, "ground at a vertex that is drawn");
            }
        }

        private static void Land(Vec3 place)
        {
            plan = null;
            swaps = 0;
            Stopwatch watch = Stopwatch.StartNew();
            scene.Land(scene.ToWorld(place), radiusM);
            // A return is shown before it is answered.
            RunUntil(() => scene.Status.Phase == LandingPhase.Shown && scene.Status.ReadyMs != null && plan != null, "a landing");
            if (Faults.Count > 0) return;
            Console.WriteLine("landing {0}: {1} segments, {2} triangles drawn, {3} base faces hidden, {4} loaded, shown after {5} ms",
                lastSwap.Landing, lastSwap.Segments.Count, scene.Figures.DrawnTriangles, lastSwap.HiddenBaseFaces, plan.LoadSegments,
                watch.ElapsedMilliseconds);
            Expect(1, swaps, "swaps of a landing");
        }

        /// <summary>Without AutoShow nothing is shown before it is asked for; that it can be is reported once.</summary>
        private static void ShowByHand()
        {
            int presentable = 0;
            Action<int> count = number => presentable++;
            scene.Presentable += count;
            scene.AutoShow = false;
            swaps = 0;
            scene.Land(scene.ToWorld(middle - new Vec3(0, 0, radiusM / 2)), radiusM);
            RunUntil(() => presentable > 0, "a landing that can be shown");
            for (int frame = 0; frame < 20; frame++) update();
            Expect(1, presentable, "times that a landing was reported as presentable");
            Expect(0, swaps, "swaps that were not asked for");
            Expect(true, scene.Show(), "shown when asked for");
            Expect(1, swaps, "swaps that were asked for");
            scene.AutoShow = true;
            scene.Presentable -= count;
        }

        /// <summary>By the user's component and the fade's: the swap and the move in one black frame; and bodies stand where feet do.</summary>
        private static void Teleport()
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
            bool isBlack = false;
            user.Arrived += point => shown += isBlack && swaps > 0 ? 1 : 100;
            swaps = 0;
            Expect(true, teleport.TeleportTo(scene.ToWorld(middle - new Vec3(radiusM / 2, 0, 0))), "a teleport begun");
            Expect(false, scene.AutoShow, "shown automatically during a teleport");
            RunUntil(
                () =>
                {
                    Send(teleport, "Update");
                    isBlack = IsCurtainClosed();
                    if (!isBlack && teleport.IsTeleporting && user.IsComing) Expect(0, swaps, "swaps in the light");
                    return !teleport.IsTeleporting;
                },
                "the end of a teleport");
            Expect(1, shown, "arrivals in the black");
            Expect(1, swaps, "swaps of a teleport");
            Expect(true, scene.AutoShow, "shown automatically again");
            Vector3 feet = rig.transform.position;
            bool isGround = scene.GroundAt(new Vector3(feet.x, feet.y + 1, feet.z), out GroundHit ground);
            Expect(true, isGround && Math.Abs(ground.Point.y - feet.y) < 0.001, "feet on the ground");
            Ray down = new Ray(new Vector3(feet.x, feet.y + 50, feet.z), new Vector3(0, -1, 0));
            Expect(true, user.TryAim(down, out Vector3 met) && Math.Abs(met.y - feet.y) < 0.001, "an aim that meets the ground");
            Physics.StubWallLayers = 6;
            Physics.StubWallAtM = 10;
            user.Obstacles = new LayerMask { value = 1 };
            Expect(true, user.TryAim(down, out met), "an aim past what is on another layer");
            user.Obstacles = new LayerMask { value = 4 };
            Expect(false, user.TryAim(down, out met), "an aim through an obstacle");
            Physics.StubWallAtM = 60;
            Expect(true, user.TryAim(down, out met), "an aim at ground before an obstacle");
            Physics.StubWallLayers = 0;
            Expect(false, user.LandAtPlace("no such place") || teleport.TeleportToPlace("no such place"), "a place that is not there");
            WalkOnSolidGround(rig.transform);
            Send(teleport, "OnDisable");
            Send(user, "OnDisable");
            UnityEngine.Object.DestroyImmediate(holder);
            UnityEngine.Object.DestroyImmediate(rig);
        }

        private static void WalkOnSolidGround(Transform feet)
        {
            TerraportGroundCollider solid = scene.gameObject.AddComponent<TerraportGroundCollider>();
            Send(solid, "OnEnable");
            RunUntil(
                () =>
                {
                    Send(solid, "Update");
                    return solid.IsComplete;
                },
                "a solid base");
            int faces = scene.gameObject.GetComponents<MeshCollider>()
                            .Where(one => one != null && one.sharedMesh != null)
                            .Sum(one => one.sharedMesh.IndexData.Length / 3);
            Expect(scene.Files.Base.FaceCount, faces, "solid faces of the base");
            Send(solid, "OnDisable");
            UnityEngine.Object.DestroyImmediate(solid);
            TerraportFeetCollider collider = scene.gameObject.AddComponent<TerraportFeetCollider>();
            collider.Feet = feet;
            Send(collider, "OnEnable");
            for (int step = 0; step < 10; step++)
            {
                Vector3 at = feet.position = feet.position + new Vector3(1.3f, 0, 0.4f);
                RunUntil(
                    () =>
                    {
                        Send(collider, "Update");
                        return collider.IsCurrent;
                    },
                    "solid ground");
                if (!scene.GroundAt(new Vector3(at.x, at.y + 1, at.z), out GroundHit ground)) continue; // Beyond the scene.
                feet.position = ground.Point;
                Mesh mesh = scene.gameObject.GetComponents<MeshCollider>().Last(one => one.sharedMesh != null).sharedMesh;
                float height = SolidHeight((Vector3[])mesh.VertexData, ground.Point);
                Expect(true, Math.Abs(height - ground.Point.y) < 0.001, "solid ground where ground is shown");
            }
            Send(collider, "OnDisable");
            UnityEngine.Object.DestroyImmediate(collider);
        }

        private static float SolidHeight(Vector3[] corners, Vector3 at)
        {
            float highest = float.MinValue;
            for (int face = 0; face < corners.Length; face += 3)
            {
                Vector3 a = corners[face], b = corners[face + 1], c = corners[face + 2];
                double ux = b.x - a.x, uz = b.z - a.z, vx = c.x - a.x, vz = c.z - a.z, x = at.x - a.x, z = at.z - a.z;
                double area = ux * vz - uz * vx, beta = (x * vz - z * vx) / area, gamma = (ux * z - uz * x) / area;
                if (beta < -1e-6 || gamma < -1e-6 || beta + gamma > 1 + 1e-6) continue;
                highest = Math.Max(highest, (float)(a.y + beta * (b.y - a.y) + gamma * (c.y - a.y)));
            }
            return highest;
        }

        /// <summary>By the group's component: a seat, a landing of the group that is followed, and its barrier opens.</summary>
        private static void GoTogether()
        {
            TerraportGroup group = scene.gameObject.AddComponent<TerraportGroup>();
            int called = 0, refused = 0;
            GroupGathering gathered = null;
            group.Called += (point, metres) => called += Math.Abs(scene.ToWorld(middle).x - point.x) < 0.001f ? 1 : 100;
            group.Gathered += gathering => gathered = gathering;
            group.Refused += (code, why) => refused++;
            Expect(false, group.Join("tour", GroupRole.Guide, "Ada"), "a seat before the component is enabled");
            Send(group, "OnEnable");
            Expect(true, group.Join("tour", GroupRole.Guide, "Ada"), "a seat asked for");
            RunUntil(() => group.Members.Count == 1, "a list of members");
            Expect(true, group.Members[0].Name == "Ada" && group.Members[0].Role == GroupRole.Guide, "a guide by the name of Ada");
            swaps = 0;
            Expect(true, group.Gather(scene.ToWorld(middle), radiusM), "a gather");
            RunUntil(
                () =>
                {
                    Send(group, "LateUpdate");
                    return gathered != null;
                },
                "everybody to be there");
            Expect(1, called, "landings of the group");
            Expect(1, swaps, "swaps of a landing with the group");
            Expect(true, gathered != null && gathered.Ready.SequenceEqual(new[] { group.Group.Member }), "the member there");
            // A member that does not follow stays, and holds nobody up.
            group.Follows = false;
            gathered = null;
            swaps = 0;
            Expect(true, group.GatherHere(), "a gather here");
            RunUntil(() => gathered != null, "nobody to be waited for");
            Expect(1, gathered == null ? 0 : gathered.Missing.Count, "members that stay");
            Expect(0, swaps + refused, "swaps without following, and refusals");
            group.Leave();
            Expect(0, group.Members.Count, "members of a group that was left");
            Send(group, "OnDisable");
            UnityEngine.Object.DestroyImmediate(group);
        }

        /// <summary>The coarser level in a ring around full detail: there automatically, and gone with a switch.</summary>
        private static void SwitchRing()
        {
            bool hasRing = scene.Files.Manifest.Levels > 1;
            Land(middle + new Vec3(radiusM, 0, 0));
            Land(middle);
            if (Faults.Count > 0) return;
            Expect(hasRing, plan.CoarserSegments > 0, "a ring");
            int hidden = lastSwap.HiddenBaseFaces, segments = scene.Files.Manifest.SegmentCount;
            Vector3 inRing = scene.ToWorld(middle + new Vec3(2 * radiusM, 100, 0));
            bool isMet = scene.GroundAt(inRing, out GroundHit ground);
            if (hasRing) Expect(true, isMet && ground.Segment < segments, "ground of the ring that names its segment");
            scene.ShowsCoarse = false;
            Land(middle);
            Expect(0, plan.CoarserSegments, "segments of a ring that is switched off");
            Expect(hasRing, lastSwap.HiddenBaseFaces < hidden, "the base shown again where the ring was");
            scene.ShowsCoarse = true;
        }

        /// <summary>A frame in which nothing happens must make no garbage.</summary>
        private static void Rest()
        {
            for (int frame = 0; frame < 200; frame++)
            {
                update();
                Thread.Sleep(1);
            }
            // Without the arrays of an invocation by name.
            var frameOfScene = (Action)Delegate.CreateDelegate(
                typeof(Action), scene, typeof(TerraportScene).GetMethod("Update", BindingFlags.Instance | BindingFlags.NonPublic));
            long before = GC.GetAllocatedBytesForCurrentThread();
            for (int frame = 0; frame < 200; frame++) frameOfScene();
            Expect(0L, GC.GetAllocatedBytesForCurrentThread() - before, "bytes of garbage at rest");
        }

        private static void Change()
        {
            string before = scene.Files.Manifest.Version;
            Console.WriteLine("change");
            Console.Out.Flush();
            Console.ReadLine();
            lastSwap = null;
            bool isNew = false;
            scene.Shown += swap => isNew |= swap.IsNewBase;
            scene.Reconnect("another");
            RunUntil(
                () => isNew && lastSwap.Landing > 0 && scene.Status.Phase == LandingPhase.Shown, "the new version, and the landing in it");
            Expect(false, before == scene.Files.Manifest.Version, "the same version");
        }

        /// <summary>A listener may close the scene from within any event.</summary>
        private static void CloseWithin()
        {
            lastSwap = null;
            Action<SceneSwap> close = swap => scene.Close();
            scene.Shown += close;
            scene.Open();
            RunUntil(() => !scene.IsOpen, "the base, once more");
            scene.Shown -= close;
        }

        /// <summary>In the editor: the base and a landing below the camera, again when it has moved, and gone when it is switched off.</summary>
        private static void Preview()
        {
            Application.StubIsPlaying = false;
            scene.gameObject.SetActive(true);
            Send(scene, "OnEnable");
            Expect(1, TerraportScene.NotPlayed.Count, "scenes for the editor to step");
            Vector3 camera = scene.ToWorld(middle + new Vec3(0, 500, 0));
            Expect(false, scene.StepPreview(camera) || scene.IsOpen, "a preview that was not switched on");
            scene.PreviewsInEditor = true;
            lastSwap = null;
            update = () => scene.StepPreview(camera);
            RunUntil(() => lastSwap != null && lastSwap.Landing > 0, "the preview's landing");
            Expect(true, UnityEngine.Object.LiveOf<MeshRenderer>().All(one => one.gameObject.hideFlags == HideFlags.HideAndDontSave),
                "hidden objects");
            int landing = scene.Status.Landing;
            camera = new Vector3(camera.x + 1, camera.y, camera.z);
            update();
            Expect(landing, scene.Status.Landing, "landings a metre aside");
            camera = new Vector3(camera.x + 0.3f * scene.DefaultRadiusM, camera.y, camera.z);
            update();
            Expect(landing + 1, scene.Status.Landing, "landings farther away");
            scene.PreviewsInEditor = false;
            update();
            Expect(false, scene.IsOpen, "a preview after it was switched off");
            scene.PreviewsInEditor = true;
            lastSwap = null;
            RunUntil(() => lastSwap != null, "the preview once more");
            Send(scene, "OnDisable"); // As before scripts are compiled.
            Expect(0, TerraportScene.NotPlayed.Count, "scenes for the editor to step, after that");
            scene.gameObject.SetActive(false);
            Application.StubIsPlaying = true;
        }

        private static void RunUntil(Func<bool> isDone, string what)
        {
            Stopwatch watch = Stopwatch.StartNew();
            while (!isDone() && Faults.Count == 0)
            {
                update();
                if (watch.ElapsedMilliseconds > PatienceMs) Faults.Add("no sign of " + what + " within " + PatienceMs + " ms");
                Thread.Sleep(FrameMs);
            }
        }

        /// <summary>What is drawn must be right in this very frame: in it the user sees the new set for the first time.</summary>
        private static void OnShown(SceneSwap swap)
        {
            lastSwap = swap;
            swaps++;
            long baseFaces = 0, detailFaces = 0;
            int detail = 0;
            foreach (MeshRenderer renderer in UnityEngine.Object.LiveOf<MeshRenderer>().Where(one => one.enabled && !IsCurtain(one)))
            {
                Mesh mesh = renderer.gameObject.GetComponent<MeshFilter>().sharedMesh;
                int faces = mesh.SubMesh.indexCount / 3;
                // The base is drawn after the detail: by another material.
                bool isBase = renderer.sharedMaterial.renderQueue > 0;
                baseFaces += isBase ? faces : 0;
                detailFaces += isBase ? 0 : faces;
                detail += isBase ? 0 : 1;
                CheckMesh(mesh);
            }
            Expect(scene.Files.Base.FaceCount - swap.HiddenBaseFaces, baseFaces, "base faces drawn");
            Expect(swap.Segments.Count, detail, "segments drawn");
            bool isOfPlan = plan != null && plan.Landing == swap.Landing && !swap.IsDegraded && scene.Status.Missing.Count == 0;
            if (isOfPlan) Expect(plan.TotalTriangles, detailFaces, "faces of segments drawn");
        }

        /// <summary>Vertices within the box, and faces that point where their normals do, by Unity's rule.</summary>
        private static void CheckMesh(Mesh mesh)
        {
            var vertices = (GroundVertex[])mesh.VertexData;
            Expect(GroundVertex.Bytes, System.Runtime.InteropServices.Marshal.SizeOf(typeof(GroundVertex)), "bytes of a vertex");
            int along = 0, against = 0;
            for (int at = 0; at < mesh.SubMesh.indexCount; at += 3)
            {
                GroundVertex a = VertexOf(mesh, vertices, at), b = VertexOf(mesh, vertices, at + 1), c = VertexOf(mesh, vertices, at + 2);
                var u = new Vec3(b.X - a.X, b.Y - a.Y, b.Z - a.Z);
                var v = new Vec3(c.X - a.X, c.Y - a.Y, c.Z - a.Z);
                double front = Vec3.Dot(Vec3.Cross(u, v), new Vec3(a.NormalX, a.NormalY, a.NormalZ));
                along += front > 0 ? 1 : 0;
                against += front < 0 ? 1 : 0;
                Vector3 away = new Vector3(a.X, a.Y, a.Z) - mesh.bounds.center, half = mesh.bounds.size * 0.501f;
                bool isInside = Math.Abs(away.x) <= half.x && Math.Abs(away.y) <= half.y && Math.Abs(away.z) <= half.z;
                if (!isInside) Faults.Add("a vertex outside of its mesh's box");
            }
            if (along < 9 * against)
                Faults.Add("of a mesh's faces " + along + " point along their normals and " + against + " against them");
        }

        private static GroundVertex VertexOf(Mesh mesh, GroundVertex[] vertices, int at)
        {
            ushort[] indices = mesh.IndexData as ushort[];
            return vertices[indices != null ? indices[at] : ((uint[])mesh.IndexData)[at]];
        }

        private static bool IsCurtain(MeshRenderer renderer) { return renderer.gameObject.name == "terraport fade"; }

        private static bool IsCurtainClosed()
        {
            return UnityEngine.Object.LiveOf<MeshRenderer>().Any(
                one => one.enabled && IsCurtain(one) && one.sharedMaterial.GetFloat(Shader.PropertyToID("_TerraportFade")) >= 1);
        }

        private static void Send(object component, string message)
        {
            component.GetType().GetMethod(message, BindingFlags.Instance | BindingFlags.NonPublic).Invoke(component, null);
        }

        // Shaders are assets: loaded, not made.
        private static int LiveCount()
        {
            return UnityEngine.Object.LiveOf<UnityEngine.Object>().Count - UnityEngine.Object.LiveOf<Shader>().Count;
        }

        private static void Expect<T>(T expected, T actual, string what)
        {
            if (!expected.Equals(actual)) Faults.Add(what + ": got " + actual + ", expected " + expected);
        }
    }
}
