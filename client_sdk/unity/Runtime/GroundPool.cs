using System;
using System.Collections.Generic;
using UnityEngine;

namespace Terraport.Unity
{
    /// <summary>Pieces of ground that are free to be used again. Each keeps its object and its mesh.</summary>
    internal sealed class GroundPool : IDisposable
    {
        /// <summary>A landing of a headset has up to 512 segments: a quarter of them at hand is enough for hops, and bounds the memory.</summary>
        private const int MaxSpares = 128;

        private readonly Transform parent;
        private readonly bool isLit;
        private readonly Stack<GroundNode> spares = new Stack<GroundNode>();

        public GroundPool(Transform parent, bool isLit)
        {
            this.parent = parent;
            this.isLit = isLit;
        }

        /// <summary>Pieces made and not destroyed.</summary>
        public int Count { get; private set; }

        /// <summary>A hidden piece whose mesh the caller fills; it holds what it held before until then.</summary>
        public GroundNode Take()
        {
            while (spares.Count > 0)
            {
                GroundNode spare = spares.Pop();
                // A project may have destroyed the objects below the scene's: such a spare only gives its mesh back.
                if (spare.IsAlive)
                {
                    return spare;
                }
                Count--;
                spare.Destroy();
            }
            Count++;
            return new GroundNode(parent, isLit);
        }

        /// <summary>Give one back; it is hidden, and loses material and photograph, which are the caller's.</summary>
        public void Return(GroundNode node)
        {
            // A returned piece must not be drawn, not even for a frame.
            node.IsShown = false;
            node.Photo = null;
            node.PhotoMaterial = null;
            if (node.IsAlive && spares.Count < MaxSpares)
            {
                spares.Push(node);
                return;
            }
            Count--;
            node.Destroy();
        }

        /// <summary>Destroy the spares; nodes that are in use are their holder's to return before.</summary>
        public void Dispose()
        {
            while (spares.Count > 0)
            {
                Count--;
                spares.Pop().Destroy();
            }
        }
    }
}
