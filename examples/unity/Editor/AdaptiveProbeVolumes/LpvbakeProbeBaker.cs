using System;
using Unity.Collections;
using UnityEditor;
using UnityEngine;
using UnityEngine.Rendering;

namespace Lpvbake
{
    /// <summary>Bakes Adaptive Probe Volumes: Unity places the probes, lpvbake lights them. What is baked is
    /// the indirect light of the scene's glTF file (Tools > lpvbake > Settings).</summary>
    public class LpvbakeProbeBaker : AdaptiveProbeVolumes.LightingBaker
    {
        readonly string program, scene, options;
        Vector3[] positions = new Vector3[0];
        bool done;
        NativeArray<SphericalHarmonicsL2> light;
        NativeArray<float> backs;
        NativeArray<Vector4> lights;

        public LpvbakeProbeBaker(string program, string scene, string options)
        {
            this.program = program;
            this.scene = scene;
            this.options = options;
        }

        public override bool isThreadSafe { get { return true; } }
        public override ulong currentStep { get { return done ? stepCount : 0; } }
        public override ulong stepCount { get { return (ulong)positions.Length; } }
        public override NativeArray<SphericalHarmonicsL2> irradiance { get { return light; } }
        public override NativeArray<float> validity { get { return backs; } }
        public override NativeArray<Vector4> occlusion { get { return lights; } }

        public override void Initialize(bool bakeProbeOcclusion, NativeArray<Vector3> probePositions)
        {
            Dispose();
            done = false;
            positions = probePositions.ToArray();
            light = new NativeArray<SphericalHarmonicsL2>(positions.Length, Allocator.Persistent);
            backs = new NativeArray<float>(positions.Length, Allocator.Persistent);
            if (!bakeProbeOcclusion)
                return;
            // Shadows of mixed lights are not baked here: all are seen.
            lights = new NativeArray<Vector4>(positions.Length, Allocator.Persistent);
            for (int i = 0; i < positions.Length; ++i)
                lights[i] = new Vector4(1, 1, 1, 1);
        }

        public override void Initialize(bool bakeProbeOcclusion, NativeArray<Vector3> probePositions,
                                        NativeArray<uint> bakedRenderingLayerMasks)
        {
            Initialize(bakeProbeOcclusion, probePositions);
        }

        public override bool Step()
        {
            if (positions.Length > 0)
            {
                try
                {
                    LpvbakeTool.Lit lit = LpvbakeTool.Bake(program, scene, options, positions, () => cancel);
                    light.CopyFrom(lit.light);
                    backs.CopyFrom(lit.backs);
                }
                catch (OperationCanceledException)
                {
                    return false;
                }
                catch (Exception error)
                {
                    Debug.LogError(error.Message);
                    return false;
                }
            }
            done = true;
            return true;
        }

        public override void Dispose()
        {
            if (light.IsCreated)
                light.Dispose();
            if (backs.IsCreated)
                backs.Dispose();
            if (lights.IsCreated)
                lights.Dispose();
        }

        [MenuItem("Tools/lpvbake/Light Adaptive Probe Volumes by lpvbake")]
        static void Use()
        {
            AdaptiveProbeVolumes.SetLightingBakerOverride(
                new LpvbakeProbeBaker(LpvbakeSettings.Program, LpvbakeSettings.Scene, LpvbakeSettings.Options));
        }

        [MenuItem("Tools/lpvbake/Light Adaptive Probe Volumes by Unity")]
        static void UseUnity()
        {
            AdaptiveProbeVolumes.SetLightingBakerOverride(null);
        }
    }
}
